// convert.h - what the core computes, as messages; and requests, as what the core takes.
#pragma once

#include <vector>
#include "ros_wire.h"
#include <catnav/MeshState.h>
#include <catnav/MeshTopology.h>
#include <catnav/PlanCatheter.h>
#include <catnav/PlanCatheterFeedback.h>
#include <catnav/PlanCatheterGoal.h>
#include <catnav/PlanCatheterResult.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/PointCloud2.h>
#include <visualization_msgs/Marker.h>
#include "ros_node.h"

namespace catnav
{
// A request as the C side sees it; points into the message, which must outlive it.
struct RequestView {
    explicit RequestView(const PlanCatheter::Request &message) { look(message); }
    explicit RequestView(const PlanCatheterGoal &message) { look(message); }
    cn_ros_request request{};

  private:
    template <class M> void look(const M &message);
    std::vector<cn_ros_limit> limits_;
};

geometry_msgs::Point point(const double *x);
Verdict toMessage(const cn_verdict &verdict);
nav_msgs::Path toMessage(const cn_path &path);
void toMessage(const cn_ros_answer &answer, PlanCatheter::Response &message);
void toMessage(const cn_ros_answer &answer, PlanCatheterResult &message);
PlanCatheterFeedback feedback(const cn_progress &progress, const char *stage, double real_time_factor,
                              int nmargin, const cn_ros_margin *margin);
sensor_msgs::PointCloud2 cloud(int n, const double *x, const double *clearance);
MeshTopology topology(const char *name, unsigned id, int ntet, const int *tet, int ntri, const int *tri);
MeshState state(unsigned id, int step, double time, int nvert, const double *x, const float *stress);

visualization_msgs::Marker marker(const char *ns, unsigned id, int type);
visualization_msgs::Marker arteryMarker(const char *name, unsigned id, const cn_surface &surface, int stride);
visualization_msgs::Marker roadmapMarker(unsigned id, const cn_roadmap &roadmap);
visualization_msgs::Marker catheterMarker(const char *name, unsigned id, int nactive, int ntri,
                                          const int *tri, int stride, const double *x, const float *stress,
                                          double full);
} // namespace catnav
