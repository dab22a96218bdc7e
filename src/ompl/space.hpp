// space.hpp - the free space as OMPL sees it: validity, motions, samplers and cost of the goal node's
// position. Thin adapters: the C core decides (cn_plan_clearance, cn_plan_edge_free, cn_plan_region), OMPL
// asks.
#ifndef CATNAV_OMPL_SPACE_HPP
#define CATNAV_OMPL_SPACE_HPP

#include <ompl/base/MotionValidator.h>
#include <ompl/base/OptimizationObjective.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/StateValidityChecker.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <vector>
#include "catnav/octree.h"
#include "catnav/plan.h"

namespace catnav
{
namespace ob = ompl::base;

inline const double *position(const ob::State *state)
{
    return state->as<ob::RealVectorStateSpace::StateType>()->values;
}
inline double *position(ob::State *state)
{
    return state->as<ob::RealVectorStateSpace::StateType>()->values;
}

// A request with what its answers need more than once.
struct Request {
    const cn_plan_query *query;
    const cn_octree *octree;
    double need;  // clearance the centre keeps [m]
    double slack; // how far outside the region it may be [m]
};

class FreeChecker : public ob::StateValidityChecker
{
  public:
    FreeChecker(const ob::SpaceInformationPtr &si, const Request &request);
    bool isValid(const ob::State *state) const override;
    double clearance(const ob::State *state) const override;

  private:
    const Request &request_;
};

// Marches along the edge by its clearance; the answer does not depend on a step size.
class EdgeValidator : public ob::MotionValidator
{
  public:
    EdgeValidator(const ob::SpaceInformationPtr &si, const Request &request)
        : MotionValidator(si), request_(request)
    {
    }
    bool checkMotion(const ob::State *a, const ob::State *b) const override;
    bool checkMotion(const ob::State *a, const ob::State *b,
                     std::pair<ob::State *, double> &last) const override;

  private:
    const Request &request_;
};

// Draws states by the spec's sampling. `uniform`: by volume of the octree's leaves. `medial_axis`: first the
// ridge, thinned to the local clearance and shuffled, then by turns jittered ridge states and uniform ones.
// `contact`: uniform ones moved along the distance's gradient to `need` from the wall. All are moved into the
// region.
class LumenSampler : public ob::RealVectorStateSampler
{
  public:
    LumenSampler(const ob::StateSpace *space, const Request &request);
    void sampleUniform(ob::State *state) override;
    size_t firstStates() const { return thinned_.size(); } // states that cover the ridge once

  private:
    void thin();
    void draw(double p[3]);
    void ridge(double p[3]);
    void toContact(double p[3]) const;

    const Request &request_;
    std::vector<int> thinned_; // ridge cells to hand out, in order
    size_t next_ = 0;
    bool even_ = false;
};

// Cost of a motion [m]: its length, weighted by scarce clearance or with turns added, as the spec asks.
class DeviceCost : public ob::OptimizationObjective
{
  public:
    DeviceCost(const ob::SpaceInformationPtr &si, const Request &request);
    ob::Cost stateCost(const ob::State *state) const override;
    ob::Cost motionCost(const ob::State *a, const ob::State *b) const override;
    ob::Cost motionCostHeuristic(const ob::State *a, const ob::State *b) const override;
    bool bends() const { return request_.query->spec->cost == CN_COST_BENDING; }
    double turnCost(const ob::State *a, const ob::State *b,
                    const ob::State *c) const; // at b, for cost bending

  private:
    const Request &request_;
};
} // namespace catnav
#endif
