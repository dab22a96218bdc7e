#include "roadmap.hpp"

#include <ompl/base/PlannerData.h>
#include <ompl/base/goals/GoalState.h>
#include <ompl/geometric/PathGeometric.h>
#include <algorithm>
#include <limits>
#include <numeric>
#include <queue>
#include <unordered_set>

namespace catnav
{
namespace
{
constexpr int neighbours = 12;

// Nearest points among n, exactly, ties by index: a k-d tree in one array of indices.
class Nearest
{
  public:
    explicit Nearest(const std::vector<ob::State *> &state) : state_(state), order_(state.size())
    {
        std::iota(order_.begin(), order_.end(), 0);
        split(0, order_.size(), 0);
    }

    // The `most` nearest of vertex i, itself left out, nearest first.
    const std::vector<std::pair<double, int>> &of(int i, size_t most)
    {
        found_.clear();
        most_ = most;
        self_ = i;
        visit(position(state_[i]), 0, order_.size(), 0);
        std::sort_heap(found_.begin(), found_.end());
        return found_;
    }

  private:
    double at(int i, int axis) const { return position(state_[i])[axis]; }

    void split(size_t first, size_t last, int axis)
    {
        if (last - first < 2) return;
        const size_t mid = (first + last) / 2;
        std::nth_element(
            order_.begin() + first, order_.begin() + mid, order_.begin() + last,
            [&](int a, int b) { return at(a, axis) != at(b, axis) ? at(a, axis) < at(b, axis) : a < b; });
        split(first, mid, (axis + 1) % 3);
        split(mid + 1, last, (axis + 1) % 3);
    }

    void visit(const double *p, size_t first, size_t last, int axis)
    {
        if (first >= last) return;
        const size_t mid = (first + last) / 2;
        const int i = order_[mid];
        const double *q = position(state_[i]), side = p[axis] - q[axis];
        if (i != self_) {
            double d2 = 0;
            for (int k = 0; k < 3; k++)
                d2 += (p[k] - q[k]) * (p[k] - q[k]);
            const std::pair<double, int> candidate(d2, i);
            if (found_.size() < most_ || candidate < found_.front()) {
                if (found_.size() == most_) {
                    std::pop_heap(found_.begin(), found_.end());
                    found_.pop_back();
                }
                found_.push_back(candidate);
                std::push_heap(found_.begin(), found_.end());
            }
        }
        const int next = (axis + 1) % 3;
        if (side < 0) {
            visit(p, first, mid, next);
            if (found_.size() < most_ || side * side <= found_.front().first) visit(p, mid + 1, last, next);
        } else {
            visit(p, mid + 1, last, next);
            if (found_.size() < most_ || side * side <= found_.front().first) visit(p, first, mid, next);
        }
    }

    const std::vector<ob::State *> &state_;
    std::vector<int> order_;
    std::vector<std::pair<double, int>> found_; // heap, farthest first
    size_t most_ = 0;
    int self_ = -1;
};
} // namespace

LazyRoadmap::LazyRoadmap(const ob::SpaceInformationPtr &si, std::shared_ptr<DeviceCost> cost)
    : Planner(si, "LazyRoadmap"), cost_(std::move(cost)), sampler_(si->allocStateSampler())
{
    specs_.approximateSolutions = false;
    specs_.optimizingPaths = true;
}

void LazyRoadmap::clear()
{
    Planner::clear();
    for (ob::State *state : vertex_)
        si_->freeState(state);
    vertex_.clear();
    edge_.clear();
    around_.clear();
    tried_ = connected_ = 0;
}

void LazyRoadmap::addState(const double p[3])
{
    ob::State *state = si_->allocState();
    std::copy(p, p + 3, position(state));
    vertex_.push_back(state);
}

void LazyRoadmap::grow(size_t most, const ob::PlannerTerminationCondition &ptc)
{
    vertex_.reserve(vertex_.size() + (most > tried_ ? most - tried_ : 0));
    ob::State *draw = si_->allocState();
    for (; tried_ < most && (tried_ % 256 || !ptc); tried_++) {
        sampler_->sampleUniform(draw);
        if (si_->isValid(draw)) vertex_.push_back(si_->cloneState(draw));
    }
    si_->freeState(draw);
    connect();
}

// Joins every vertex not joined yet to its nearest ones, old and new.
void LazyRoadmap::connect()
{
    Nearest nearest(vertex_);
    std::unordered_set<unsigned long long> known;
    for (const Edge &edge : edge_)
        known.insert((unsigned long long)edge.a << 32 | (unsigned)edge.b);
    around_.resize(vertex_.size());
    for (size_t i = connected_; i < vertex_.size(); i++)
        for (const auto &near : nearest.of(int(i), neighbours)) {
            const int a = std::min(int(i), near.second), b = std::max(int(i), near.second);
            if (!known.insert((unsigned long long)a << 32 | (unsigned)b).second) continue;
            around_[a].push_back(int(edge_.size()));
            around_[b].push_back(int(edge_.size()));
            edge_.push_back({a, b, cost_->motionCost(vertex_[a], vertex_[b]).value(), unknown});
        }
    connected_ = vertex_.size();
}

bool LazyRoadmap::edgeValid(int edge)
{
    Edge &e = edge_[edge];
    if (e.validity == unknown) e.validity = si_->checkMotion(vertex_[e.a], vertex_[e.b]) ? valid : invalid;
    return e.validity == valid;
}

int LazyRoadmap::vertexAt(const ob::State *state)
{
    for (size_t i = 0; i < vertex_.size(); i++)
        if (si_->equalStates(vertex_[i], state)) return int(i);
    addState(position(state));
    connect();
    return int(vertex_.size()) - 1;
}

// A* over vertices, or over directed edges where turns cost: an entry is the arrival at a vertex by an edge.
// The edge is tested when its arrival is taken from the queue.
bool LazyRoadmap::search(int start, int goal, std::vector<int> &route,
                         const ob::PlannerTerminationCondition &ptc)
{
    struct Arrival {
        double total, cost; // with and without the heuristic
        int half;           // directed edge, -1 at the start: 2 edge + (1: from b to a)
        bool operator<(const Arrival &o) const { return total != o.total ? total > o.total : half > o.half; }
    };
    const bool bends = cost_->bends();
    std::vector<char> closed(bends ? 2 * edge_.size() : vertex_.size(), 0);
    std::vector<double> best(2 * edge_.size(), std::numeric_limits<double>::infinity());
    std::vector<int> came(2 * edge_.size(), -1); // half-edge before this one
    std::priority_queue<Arrival> queue;
    const auto from = [&](int half) { return half & 1 ? edge_[half / 2].b : edge_[half / 2].a; };
    const auto to = [&](int half) { return half & 1 ? edge_[half / 2].a : edge_[half / 2].b; };
    size_t taken = 0;

    queue.push({0, 0, -1});
    while (!queue.empty() && (++taken % 1024 || !ptc)) {
        const Arrival arrival = queue.top();
        queue.pop();
        const int half = arrival.half, here = half < 0 ? start : to(half);
        if (half >= 0) {
            char &done = closed[bends ? half : here];
            if (done || !edgeValid(half / 2)) continue;
            done = 1;
        } else if (!bends) {
            closed[here] = 1;
        }
        if (here == goal) {
            route.assign(1, here);
            for (int h = half; h >= 0; h = came[h])
                route.push_back(from(h));
            std::reverse(route.begin(), route.end());
            return true;
        }
        for (const int edge : around_[here]) {
            const int on = 2 * edge + (edge_[edge].b == here), there = to(on);
            if (edge_[edge].validity == invalid || closed[bends ? on : there]) continue;
            double cost = arrival.cost + edge_[edge].cost;
            if (bends && half >= 0)
                cost += cost_->turnCost(vertex_[from(half)], vertex_[here], vertex_[there]);
            if (!(cost < best[on])) continue;
            best[on] = cost;
            came[on] = half;
            const double left = cost_->motionCostHeuristic(vertex_[there], vertex_[goal]).value();
            queue.push({cost + left, cost, on});
        }
    }
    return false;
}

ob::PlannerStatus LazyRoadmap::solve(const ob::PlannerTerminationCondition &ptc)
{
    checkValidity();
    const int start = vertexAt(pdef_->getStartState(0));
    const int goal = vertexAt(pdef_->getGoal()->as<ob::GoalState>()->getState());
    std::vector<int> route;

    if (!search(start, goal, route, ptc)) return ob::PlannerStatus::TIMEOUT;
    auto path = std::make_shared<ompl::geometric::PathGeometric>(si_);
    for (const int i : route)
        path->append(vertex_[i]);
    pdef_->addSolutionPath(path, false, 0, getName());
    return ob::PlannerStatus::EXACT_SOLUTION;
}

void LazyRoadmap::getPlannerData(ob::PlannerData &data) const
{
    Planner::getPlannerData(data);
    for (ob::State *state : vertex_)
        data.addVertex(ob::PlannerDataVertex(state));
    for (const Edge &edge : edge_)
        if (edge.validity == valid)
            data.addEdge(ob::PlannerDataVertex(vertex_[edge.a]), ob::PlannerDataVertex(vertex_[edge.b]));
}
} // namespace catnav
