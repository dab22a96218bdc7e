#include "space.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include "catnav/vec3.h"

namespace catnav
{
FreeChecker::FreeChecker(const ob::SpaceInformationPtr &si, const Request &request)
    : StateValidityChecker(si), request_(request)
{
    specs_.clearanceComputationType = ob::StateValidityCheckerSpecs::EXACT;
}

bool FreeChecker::isValid(const ob::State *state) const
{
    const double *p = position(state);
    const cn_plan_query *query = request_.query;
    if (!cn_octree_free_at(request_.octree, p)) return false;
    for (int i = 0; i < query->nrefused; i++)
        if (!(cn_distance(p, query->refused[i].centre) >= query->refused[i].radius)) return false;
    return cn_plan_clearance(query, p, request_.need) >= request_.need &&
           cn_plan_region(query, p, nullptr) <= request_.slack;
}

double FreeChecker::clearance(const ob::State *state) const
{
    return cn_plan_clearance(request_.query, position(state), INFINITY);
}

bool EdgeValidator::checkMotion(const ob::State *a, const ob::State *b) const
{
    return cn_plan_edge_free(request_.query, position(a), position(b), request_.need, request_.slack);
}

bool EdgeValidator::checkMotion(const ob::State *a, const ob::State *b,
                                std::pair<ob::State *, double> &last) const
{
    if (checkMotion(a, b)) return true;
    last.second = 0; // the motion's start is the last state known to be valid
    if (last.first) si_->copyState(last.first, a);
    return false;
}

LumenSampler::LumenSampler(const ob::StateSpace *space, const Request &request)
    : RealVectorStateSampler(space), request_(request)
{
    rng_.setLocalSeed(request.query->seed);
    if (request.query->spec->sampling == CN_SAMPLING_MEDIAL_AXIS) thin();
}

// One ridge cell a bucket, the one with most room; a bucket's side is the power of two of cells next below
// half the clearance, so narrow vessels keep dense samples and wide ones few. The seed shifts the buckets and
// the order.
void LumenSampler::thin()
{
    struct Key {
        int level, x, y, z;
        bool operator==(const Key &k) const { return level == k.level && x == k.x && y == k.y && z == k.z; }
    };
    struct Hash {
        size_t operator()(const Key &k) const
        {
            return (size_t(k.x) * 73856093u) ^ (size_t(k.y) * 19349663u) ^ (size_t(k.z) * 83492791u) ^
                   (size_t(k.level) << 27);
        }
    };
    const cn_map *map = request_.query->world->map;
    const double cell = cn_map_cell(map);
    const double *x, *clearance;
    const int n = cn_map_ridge(map, &x, &clearance);
    double origin[3];
    int size[3];
    std::unordered_map<Key, size_t, Hash> bucket;

    cn_map_frame(map, origin, size);
    for (double &o : origin)
        o -= cell * rng_.uniformInt(0, 63);
    for (int i = 0; i < n; i++) {
        if (!(clearance[i] + cell >= request_.need)) continue; // exact test: isValid
        const int level = std::max(0, std::ilogb(clearance[i] / cell));
        const double side = std::ldexp(cell, level);
        const Key key = {level, int((x[3 * i] - origin[0]) / side), int((x[3 * i + 1] - origin[1]) / side),
                         int((x[3 * i + 2] - origin[2]) / side)};
        const auto found = bucket.find(key);
        if (found == bucket.end()) {
            bucket.emplace(key, thinned_.size());
            thinned_.push_back(i);
        } else if (clearance[i] > clearance[thinned_[found->second]]) {
            thinned_[found->second] = i;
        }
    }
    for (size_t i = thinned_.size(); i > 1; i--)
        std::swap(thinned_[i - 1], thinned_[size_t(rng_.uniformInt(0, int(i) - 1))]);
}

void LumenSampler::draw(double p[3])
{
    double u[4];
    for (double &v : u)
        v = rng_.uniform01();
    cn_octree_sample(request_.octree, u, p);
}

void LumenSampler::ridge(double p[3])
{
    const double *x, *clearance;
    const int n = cn_map_ridge(request_.query->world->map, &x, &clearance);
    if (n == 0) return draw(p);
    if (next_ < thinned_.size()) return cn_copy3(x + 3 * thinned_[next_++], p);
    if ((even_ = !even_)) return draw(p);
    const int i = rng_.uniformInt(0, n - 1);
    const double reach = std::max(0.0, clearance[i] - request_.need);
    for (int k = 0; k < 3; k++)
        p[k] = x[3 * i + k] + reach * rng_.uniformReal(-1, 1);
}

void LumenSampler::toContact(double p[3]) const
{
    const double target = 1.03 * request_.need;
    for (int i = 0; i < 4; i++) { // the nearest triangle changes on the way
        double nearest[3], away[3];
        const double d = cn_world_distance(request_.query->world, p, nullptr, nullptr, nearest);
        if (!(d > 0) || !std::isfinite(d) || std::fabs(d - target) <= 0.01 * target) return;
        cn_sub(p, nearest, away);
        cn_axpy((target - d) / d, away, p);
    }
}

void LumenSampler::sampleUniform(ob::State *state)
{
    double *p = position(state), toward[3];
    const cn_path_spec *spec = request_.query->spec;
    if (spec->sampling == CN_SAMPLING_MEDIAL_AXIS)
        ridge(p);
    else
        draw(p);
    if (spec->sampling == CN_SAMPLING_CONTACT) toContact(p);
    const double outside = cn_plan_region(request_.query, p, toward);
    if (outside > 0 && std::isfinite(outside)) cn_axpy(outside, toward, p);
}

DeviceCost::DeviceCost(const ob::SpaceInformationPtr &si, const Request &request)
    : OptimizationObjective(si), request_(request)
{
    description_ = "device";
}

// Weight of a length passed here: 1 where there is room, towards 1600 where the device just fits.
ob::Cost DeviceCost::stateCost(const ob::State *state) const
{
    if (request_.query->spec->cost != CN_COST_CLEARANCE) return ob::Cost(1);
    const double scale = std::max(request_.need, cn_map_cell(request_.query->world->map));
    const double room = cn_map_clearance(request_.query->world->map, position(state)) - 0.9 * request_.need;
    const double ratio = 4 * scale / std::max(room, 0.1 * scale);
    return ob::Cost(1 + ratio * ratio);
}

ob::Cost DeviceCost::motionCost(const ob::State *a, const ob::State *b) const
{
    return ob::Cost(si_->distance(a, b) * std::max(stateCost(a).value(), stateCost(b).value()));
}

ob::Cost DeviceCost::motionCostHeuristic(const ob::State *a, const ob::State *b) const
{
    return ob::Cost(si_->distance(a, b));
}

// Bending energy of the polyline, theta^2 over the mean of both lengths, made a length by (10 device
// diameters)^2.
double DeviceCost::turnCost(const ob::State *a, const ob::State *b, const ob::State *c) const
{
    double u[3], v[3];
    cn_sub(position(b), position(a), u);
    cn_sub(position(c), position(b), v);
    const double lu = cn_normalise(u), lv = cn_normalise(v);
    if (!(lu > 0 && lv > 0)) return 0;
    const double theta = std::acos(std::min(1.0, std::max(-1.0, cn_dot(u, v))));
    const double scale = 10 * request_.query->device_diameter;
    return scale * scale * theta * theta * 2 / (lu + lv);
}
} // namespace catnav
