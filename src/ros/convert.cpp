#include "convert.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <Eigen/Geometry>

namespace catnav
{
// A row of plain numbers, so a view costs no copy.
static_assert(sizeof(geometry_msgs::Point) == 3 * sizeof(double), "points are packed");

template <class M> void RequestView::look(const M &m)
{
    for (const Limit &l : m.limits)
        limits_.push_back({l.body.c_str(), l.quantity.c_str(), l.reduce.c_str(), l.limit});
    request.frame = m.header.frame_id.c_str();
    request.nwaypoint = int(m.waypoints.size());
    request.waypoint = m.waypoints.empty() ? nullptr : &m.waypoints[0].x;
    request.nlimit = int(limits_.size());
    request.limit = limits_.data();
    request.sampling = m.sampling.c_str();
    request.scene = m.scene.c_str();
    request.budget = m.budget;
    request.seed = m.seed;
    request.stamp = m.header.stamp.toNSec();
}

template void RequestView::look(const PlanCatheter::Request &);
template void RequestView::look(const PlanCatheterGoal &);

geometry_msgs::Point point(const double *x)
{
    geometry_msgs::Point p;
    p.x = x[0], p.y = x[1], p.z = x[2];
    return p;
}

// Nothing non-finite is published: what is undefined is 0 here and null in the report.
static double finite(double value)
{
    return std::isfinite(value) ? value : 0;
}

Verdict toMessage(const cn_verdict &v)
{
    Verdict m;
    m.code = uint8_t(v.code);
    m.message = v.message;
    m.fault = cn_fault_name(v.fault);
    m.quantity = v.has_quantity ? cn_quantity_name(v.quantity) : "";
    m.body = v.body;
    m.value = finite(v.value);
    m.limit = finite(v.limit);
    m.element = v.element;
    m.step = v.step;
    m.waypoint = v.waypoint;
    m.time = finite(v.time);
    if (std::isfinite(v.position[0] + v.position[1] + v.position[2])) m.position = point(v.position);
    return m;
}

// Poses look along the path: x is the tangent, y the frame's normal.
nav_msgs::Path toMessage(const cn_path &path)
{
    nav_msgs::Path m;
    m.poses.resize(size_t(path.n));
    for (int i = 0; i < path.n; i++) {
        const Eigen::Vector3d t(path.tangent + 3 * i), n(path.normal + 3 * i);
        Eigen::Matrix3d r;
        r << t, n, t.cross(n);
        const Eigen::Quaterniond q(r);
        auto &pose = m.poses[size_t(i)].pose;
        pose.position = point(path.x + 3 * i);
        pose.orientation.x = q.x(), pose.orientation.y = q.y(), pose.orientation.z = q.z();
        pose.orientation.w = q.w();
    }
    return m;
}

template <class M> static void answerTo(const cn_ros_answer &answer, M &m)
{
    m.verdict = toMessage(answer.report.verdict);
    if (answer.path) m.path = toMessage(*answer.path);
    m.path.header.frame_id = answer.frame;
    m.path.header.stamp = ros::Time::now();
    for (auto &pose : m.path.poses)
        pose.header = m.path.header;
    m.steps = uint32_t(answer.report.steps);
    m.replans = uint32_t(answer.report.replans);
    m.gap_min = finite(answer.report.contact.gap_min);
    if (answer.json) m.report_json = answer.json;
}
void toMessage(const cn_ros_answer &answer, PlanCatheter::Response &message)
{
    answerTo(answer, message);
}
void toMessage(const cn_ros_answer &answer, PlanCatheterResult &message)
{
    answerTo(answer, message);
}

PlanCatheterFeedback feedback(const cn_progress &p, const char *stage, double real_time_factor, int nmargin,
                              const cn_ros_margin *margin)
{
    PlanCatheterFeedback m;
    m.stage = uint8_t(p.stage);
    m.stage_name = stage;
    m.waypoint = p.waypoint, m.waypoints = p.nwaypoint;
    m.step = uint32_t(p.step);
    m.time = p.time, m.time_limit = finite(p.time_limit);
    m.steps_per_second = finite(p.steps_per_s), m.real_time_factor = finite(real_time_factor);
    m.replans = uint32_t(p.replans);
    m.margin = std::isfinite(p.margin) ? p.margin : 1;
    m.margin_of = p.margin_of;
    for (int i = 0; i < nmargin; i++) {
        Margin one;
        const bool least = margin[i].limit.quantity == CN_QUANTITY_CLEARANCE;
        const double limit = margin[i].limit.limit, worst = margin[i].worst;
        one.body = margin[i].body;
        one.quantity = cn_quantity_name(margin[i].limit.quantity);
        one.reduce = margin[i].limit.reduce == CN_REDUCE_MEAN ? "mean" : "max";
        one.limit = limit;
        one.worst = finite(worst);
        one.margin = 1;
        if (std::isfinite(worst)) {
            const double ratio = least ? limit / worst : worst / limit;
            one.margin = std::isfinite(ratio) ? 1 - ratio : limit > 0 ? 1 : 0;
        }
        m.margins.push_back(one);
    }
    return m;
}

sensor_msgs::PointCloud2 cloud(int n, const double *x, const double *clearance)
{
    sensor_msgs::PointCloud2 m;
    const char *names[] = {"x", "y", "z", "clearance"}; // [m]
    for (uint32_t i = 0; i < 4; i++) {
        sensor_msgs::PointField field;
        field.name = names[i];
        field.offset = 4 * i;
        field.datatype = sensor_msgs::PointField::FLOAT32;
        field.count = 1;
        m.fields.push_back(field);
    }
    m.height = 1;
    m.width = uint32_t(n);
    m.point_step = 16;
    m.row_step = 16 * m.width;
    m.is_dense = true;
    m.data.resize(size_t(16) * m.width);
    for (int i = 0; i < n; i++) {
        const float row[] = {float(x[3 * i]), float(x[3 * i + 1]), float(x[3 * i + 2]), float(clearance[i])};
        memcpy(&m.data[size_t(16) * size_t(i)], row, sizeof row);
    }
    return m;
}

MeshTopology topology(const char *name, unsigned id, int ntet, const int *tet, int ntri, const int *tri)
{
    MeshTopology m;
    m.name = name;
    m.id = id;
    m.tetrahedra.assign(tet, tet + 4 * size_t(ntet));
    m.triangles.resize(size_t(ntri));
    for (size_t i = 0; i < m.triangles.size(); i++)
        std::copy_n(tri + 3 * i, 3, m.triangles[i].vertex_indices.begin());
    return m;
}

MeshState state(unsigned id, int step, double time, int nvert, const double *x, const float *stress)
{
    MeshState m;
    m.topology = id;
    m.step = uint32_t(step);
    m.time = time;
    m.vertices.resize(size_t(nvert));
    for (int i = 0; i < nvert; i++)
        m.vertices[size_t(i)] = point(x + 3 * i);
    m.stress.assign(stress, stress + nvert);
    return m;
}

visualization_msgs::Marker marker(const char *ns, unsigned id, int type)
{
    visualization_msgs::Marker m;
    m.ns = ns;
    m.id = int32_t(id);
    m.type = type;
    m.action = visualization_msgs::Marker::ADD;
    m.pose.orientation.w = 1;
    m.scale.x = m.scale.y = m.scale.z = 1;
    m.color.r = m.color.g = m.color.b = m.color.a = 1;
    return m;
}

visualization_msgs::Marker arteryMarker(const char *name, unsigned id, const cn_surface &surface, int stride)
{
    auto m = marker(name, id, visualization_msgs::Marker::TRIANGLE_LIST);
    m.color.r = 0.85f, m.color.g = 0.35f, m.color.b = 0.3f, m.color.a = 0.3f;
    m.points.reserve(3 * size_t(surface.ntri / stride + 1));
    for (int i = 0; i < surface.ntri; i += stride)
        for (int k = 0; k < 3; k++)
            m.points.push_back(point(surface.vert + 3 * surface.tri[3 * i + k]));
    return m;
}

visualization_msgs::Marker roadmapMarker(unsigned id, const cn_roadmap &roadmap)
{
    auto m = marker("roadmap", id, visualization_msgs::Marker::LINE_LIST);
    m.scale.x = 2e-4; // line width [m]
    m.color.r = 0.1f, m.color.g = 0.3f, m.color.b = 0.7f, m.color.a = 0.4f;
    m.points.reserve(2 * size_t(roadmap.nedge));
    for (int i = 0; i < 2 * roadmap.nedge; i++)
        m.points.push_back(point(roadmap.vertex + 3 * roadmap.edge[i]));
    return m;
}

// Blue at 0 over green and yellow to red at 1 and beyond.
static std_msgs::ColorRGBA colour(double ratio)
{
    const double r = std::min(std::max(ratio, 0.), 1.) * 3;
    std_msgs::ColorRGBA c;
    c.r = float(std::min(std::max(r - 1, 0.), 1.));
    c.g = float(r < 1 ? r : std::min(3 - r, 1.));
    c.b = float(std::max(1 - r, 0.));
    c.a = 1;
    return c;
}

visualization_msgs::Marker catheterMarker(const char *name, unsigned id, int nactive, int ntri,
                                          const int *tri, int stride, const double *x, const float *stress,
                                          double full)
{
    auto m = marker(name, id, visualization_msgs::Marker::TRIANGLE_LIST);
    for (int i = 0; i < ntri; i += stride) {
        const int *v = tri + 3 * i;
        if (std::max({v[0], v[1], v[2]}) >= nactive) continue;
        for (int k = 0; k < 3; k++) {
            m.points.push_back(point(x + 3 * v[k]));
            m.colors.push_back(colour(full > 0 ? double(stress[v[k]]) / full : 0));
        }
    }
    // rviz refuses an empty list: nothing out of the sheath yet is a marker taken away
    if (m.points.empty()) m.action = visualization_msgs::Marker::DELETE;
    return m;
}
} // namespace catnav
