// roadmap.hpp - a lazy roadmap as an OMPL planner: states are drawn and joined to their nearest ones without
// a test, A* tests an edge when it takes it. One thread, ties broken by index, states only from the space's
// own sampler: the same seed gives the same roadmap and path. (OMPL's LazyPRM searches again after every
// milestone and its nearest neighbours are pivoted by the process-wide seed.) Kept between queries: legs and
// replans share it.
#ifndef CATNAV_OMPL_ROADMAP_HPP
#define CATNAV_OMPL_ROADMAP_HPP

#include <ompl/base/Planner.h>
#include <array>
#include <vector>
#include "space.hpp"

namespace catnav
{
class LazyRoadmap : public ob::Planner
{
  public:
    LazyRoadmap(const ob::SpaceInformationPtr &si, std::shared_ptr<DeviceCost> cost);
    ~LazyRoadmap() override { LazyRoadmap::clear(); }

    void addState(const double p[3]); // a state the caller vouches for
    // Draws until `most` vertices were tried in all; invalid draws count. ptc is asked now and then.
    void grow(size_t most, const ob::PlannerTerminationCondition &ptc);
    size_t tried() const { return tried_; }

    // Searches what there is between the problem's start and goal; EXACT_SOLUTION or TIMEOUT. Does not grow.
    ob::PlannerStatus solve(const ob::PlannerTerminationCondition &ptc) override;
    void clear() override;
    void getPlannerData(ob::PlannerData &data) const override; // vertices and the edges found valid

  private:
    enum Validity : signed char { unknown, valid, invalid };
    struct Edge {
        int a, b;
        double cost;
        Validity validity;
    };
    void connect();
    bool edgeValid(int edge);
    int vertexAt(const ob::State *state);
    bool search(int start, int goal, std::vector<int> &route, const ob::PlannerTerminationCondition &ptc);

    std::shared_ptr<DeviceCost> cost_;
    ob::StateSamplerPtr sampler_;
    std::vector<ob::State *> vertex_;
    std::vector<Edge> edge_;
    std::vector<std::vector<int>> around_; // edges of each vertex
    size_t tried_ = 0, connected_ = 0;     // draws; vertices already joined
};
} // namespace catnav
#endif
