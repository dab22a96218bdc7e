// ompl_planner.cpp - cn_ompl_planner: a request in, a roadmap and its polyline out. Exceptions stop here.
#include "catnav/plan.h"

#include <ompl/base/PlannerData.h>
#include <ompl/base/PlannerTerminationCondition.h>
#include <ompl/base/ProblemDefinition.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/util/Console.h>
#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <new>
#include "roadmap.hpp"

namespace
{
using namespace catnav;

struct OctreeFree {
    void operator()(cn_octree *octree) const { cn_octree_free(octree); }
};
using OctreePtr = std::unique_ptr<cn_octree, OctreeFree>; // the request's own, where the world has none

// OMPL's messages go where ours go.
class LogHandler : public ompl::msg::OutputHandler
{
  public:
    void log(const std::string &text, ompl::msg::LogLevel level, const char *file, int line) override
    {
        cn_log_write(level >= ompl::msg::LOG_ERROR  ? CN_LOG_ERROR
                     : level == ompl::msg::LOG_WARN ? CN_LOG_WARNING
                                                    : CN_LOG_DEBUG,
                     file, line, "%s", text.c_str());
    }
};

void quieten()
{
    static LogHandler handler;
    static std::once_flag once;
    std::call_once(once, [] { ompl::msg::useOutputHandler(&handler); });
}

// When a search has to end early: cancelled, or the emergency budget is used up.
class Stop
{
  public:
    explicit Stop(const cn_plan_query *query) : query_(query), begin_(std::chrono::steady_clock::now()) {}
    bool cancelled() const { return cn_cancelled(query_->cancel); }
    bool late() const
    {
        const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - begin_;
        return !(spent.count() < query_->budget);
    }

  private:
    const cn_plan_query *query_;
    std::chrono::steady_clock::time_point begin_;
};

ob::SpaceInformationPtr makeSpace(const Request &request, size_t &first)
{
    const cn_plan_query *query = request.query;
    auto space = std::make_shared<ob::RealVectorStateSpace>(3);
    ob::RealVectorBounds bounds(3);
    double origin[3];
    int size[3];
    cn_map_frame(query->world->map, origin, size);
    for (int k = 0; k < 3; k++) {
        bounds.low[k] = origin[k];
        bounds.high[k] = origin[k] + size[k] * cn_map_cell(query->world->map);
        for (int i = 0; i < query->npoint; i++) {
            bounds.low[k] = std::min(bounds.low[k], query->point[3 * i + k]);
            bounds.high[k] = std::max(bounds.high[k], query->point[3 * i + k]);
        }
    }
    space->setBounds(bounds);
    space->setStateSamplerAllocator([&request, &first](const ob::StateSpace *s) {
        auto sampler = std::make_shared<LumenSampler>(s, request);
        first = sampler->firstStates();
        return sampler;
    });
    auto si = std::make_shared<ob::SpaceInformation>(space);
    si->setStateValidityChecker(std::make_shared<FreeChecker>(si, request));
    si->setMotionValidator(std::make_shared<EdgeValidator>(si, request));
    si->setup();
    return si;
}

ob::ProblemDefinitionPtr makeProblem(const ob::SpaceInformationPtr &si, const double *from, const double *to)
{
    auto problem = std::make_shared<ob::ProblemDefinition>(si);
    ob::ScopedState<ob::RealVectorStateSpace> start(si), goal(si);
    std::copy(from, from + 3, start->values);
    std::copy(to, to + 3, goal->values);
    problem->setStartAndGoalStates(start, goal, 0);
    return problem;
}

// The narrowest place of leg i, into *roadmap.
void pinch(const cn_plan_query *query, int i, cn_roadmap *roadmap)
{
    roadmap->failed_leg = i;
    roadmap->pinch_radius =
        cn_map_pinch(query->world->map, query->point + 3 * i, query->point + 3 * i + 3, roadmap->pinch);
}

cn_status noPath(const Request &request, size_t tried, const cn_roadmap *roadmap, cn_error *error)
{
    const cn_plan_query *query = request.query;
    const double *to = query->point + 3 * (roadmap->failed_leg + 1), *at = roadmap->pinch;
    const double room = roadmap->pinch_radius;
    char why[160];
    if (!(room > 0))
        std::snprintf(why, sizeof why, "the free space does not join them; it ends at (%.4g, %.4g, %.4g) mm",
                      1e3 * at[0], 1e3 * at[1], 1e3 * at[2]);
    else
        std::snprintf(why, sizeof why,
                      "the widest way narrows to a radius of %.3g mm at (%.4g, %.4g, %.4g) mm", 1e3 * room,
                      1e3 * at[0], 1e3 * at[1], 1e3 * at[2]);
    return cn_fail(
        error, CN_ERR_NO_PATH, nullptr, 0,
        "no path to waypoint %d at (%.4g, %.4g, %.4g) mm after %zu samples, %d places refused: %s, and the "
        "device needs %.3g mm",
        roadmap->failed_leg, 1e3 * to[0], 1e3 * to[1], 1e3 * to[2], tried, query->nrefused, why,
        1e3 * request.need);
}

template <class T> T *array(size_t n)
{
    T *a = static_cast<T *>(std::malloc(std::max<size_t>(n, 1) * sizeof(T)));
    if (!a) throw std::bad_alloc();
    return a;
}

void fill(cn_roadmap *roadmap, const LazyRoadmap &planner, const ob::SpaceInformationPtr &si)
{
    ob::PlannerData data(si);
    planner.getPlannerData(data);
    std::vector<unsigned> targets;
    std::vector<int> pairs;
    roadmap->vertex = array<double>(3 * data.numVertices());
    for (unsigned i = 0; i < data.numVertices(); i++) {
        const double *p = position(data.getVertex(i).getState());
        std::copy(p, p + 3, roadmap->vertex + 3 * i);
        data.getEdges(i, targets);
        std::sort(targets.begin(), targets.end());
        for (const unsigned j : targets)
            pairs.insert(pairs.end(), {int(i), int(j)});
    }
    roadmap->nvertex = int(data.numVertices());
    roadmap->edge = array<int>(pairs.size());
    std::copy(pairs.begin(), pairs.end(), roadmap->edge);
    roadmap->nedge = int(pairs.size() / 2);
}

cn_status plan(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error)
{
    OctreePtr own;
    if (!query->world->octree) {
        cn_octree *made = nullptr;
        const cn_status status = cn_octree_new(&made, query->world->map, error);
        if (status != CN_OK) return status;
        own.reset(made);
    }
    const Request request = {query, own ? own.get() : query->world->octree,
                             query->radius + query->spec->clearance, cn_plan_region_slack(query)};
    size_t first = 0;
    const ob::SpaceInformationPtr si = makeSpace(request, first);
    LazyRoadmap planner(si, std::make_shared<DeviceCost>(si, request));
    const Stop stop(query);
    const ob::PlannerTerminationCondition ptc([&stop] { return stop.cancelled() || stop.late(); });

    /* the ridge once and as much again of others, which bridge what it leaves open */
    first = first ? 2 * first : 2000;
    const size_t most = query->samples < 0 ? std::max<size_t>(32000, 2 * first) : size_t(query->samples);
    size_t target = std::min(first, most);
    std::vector<double> x(query->point, query->point + 3);
    std::vector<int> leg(1, 0);

    for (int i = 0; i < query->npoint; i++)
        planner.addState(query->point + 3 * i);
    planner.grow(target, ptc);
    for (int i = 0; i + 1 < query->npoint; i++) {
        const ob::ProblemDefinitionPtr problem =
            makeProblem(si, query->point + 3 * i, query->point + 3 * i + 3);
        planner.setProblemDefinition(problem);
        for (int attempt = 0; planner.solve(ptc) != ob::PlannerStatus::EXACT_SOLUTION; attempt++) {
            if (stop.cancelled())
                return cn_fail(error, CN_ERR_CANCELLED, nullptr, 0, "cancelled while a path was sought");
            if (stop.late()) {
                roadmap->reproducible = false;
                roadmap->failed_leg = i;
                return cn_fail(error, CN_ERR_TIMEOUT, nullptr, 0,
                               "no path to waypoint %d within planner.budget (%g s, %zu samples)", i,
                               query->budget, planner.tried());
            }
            if (attempt == 1 || target >= most) pinch(query, i, roadmap);
            /* the map is exact to about a cell: where two more do not help, no sample will */
            const bool hopeless =
                attempt >= 1 && roadmap->pinch_radius + 2 * cn_map_cell(query->world->map) < request.need;
            if (hopeless || target >= most) {
                fill(roadmap, planner, si);
                return noPath(request, planner.tried(), roadmap, error);
            }
            target = std::min(most, 2 * target);
            planner.grow(target, ptc);
        }
        const auto *path = problem->getSolutionPath()->as<ompl::geometric::PathGeometric>();
        for (size_t j = 1; j < path->getStateCount(); j++) {
            x.insert(x.end(), position(path->getState(j)), position(path->getState(j)) + 3);
            leg.push_back(i + 1);
        }
    }
    fill(roadmap, planner, si);
    roadmap->x = array<double>(x.size());
    roadmap->leg = array<int>(leg.size());
    std::copy(x.begin(), x.end(), roadmap->x);
    std::copy(leg.begin(), leg.end(), roadmap->leg);
    roadmap->npoint = int(leg.size());
    return CN_OK;
}
} // namespace

cn_status cn_ompl_planner(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error)
{
    try {
        quieten();
        *roadmap = cn_roadmap();
        roadmap->reproducible = true;
        return plan(query, roadmap, error);
    } catch (const std::bad_alloc &) {
        return cn_fail(error, CN_ERR_MEMORY, nullptr, 0, "out of memory while a path was sought");
    } catch (const std::exception &e) {
        return cn_fail(error, CN_ERR_ARG, nullptr, 0, "the planner refused the request: %s", e.what());
    }
}
