// ros_show.cpp - what the node shows: bodies, walls, roadmap, path, medial axis.
#include "ros_parts.h"

using catnav::guarded;
using visualization_msgs::Marker;

static Marker removed(const Marker &old)
{
    Marker m;
    m.header = old.header;
    m.ns = old.ns;
    m.id = old.id;
    m.action = Marker::DELETE;
    return m;
}

void advertiseShow(cn_ros *ros)
{
    auto &h = ros->handle;
    ros->topology.advertise(h, "catheter_topology");
    ros->state = h.advertise<catnav::MeshState>("catheter_mesh", 64); // what is past is not a state
    ros->catheter.advertise(h, "catheter_marker");
    ros->artery.advertise(h, "artery_marker");
    ros->roadmap.advertise(h, "roadmap_marker");
    ros->path.advertise(h, "path");
    ros->medial_axis.advertise(h, "medial_axis");
}

void cn_ros_send_topology(cn_ros *ros, const char *frame, const char *name, unsigned id, int ntet,
                          const int *tet, int ntri, const int *tri)
{
    guarded([&] { ros->topology.send(frame, id, catnav::topology(name, id, ntet, tet, ntri, tri)); });
}

void cn_ros_send_state(cn_ros *ros, const char *frame, unsigned id, int step, double time, int nvert,
                       const double *x, const float *stress)
{
    guarded([&] {
        auto message = catnav::state(id, step, time, nvert, x, stress);
        message.header.frame_id = frame;
        message.header.stamp = ros::Time::now();
        ros->state.publish(message);
    });
}

void cn_ros_send_catheter(cn_ros *ros, const char *frame, const char *name, unsigned id, int nactive,
                          int ntri, const int *tri, int stride, const double *x, const float *stress,
                          double full)
{
    guarded([&] {
        ros->catheter.send(frame, id,
                           catnav::catheterMarker(name, id, nactive, ntri, tri, stride, x, stress, full));
    });
}

void cn_ros_send_artery(cn_ros *ros, const char *frame, const char *name, unsigned id,
                        const cn_surface *surface, int stride)
{
    guarded([&] { ros->artery.send(frame, id, catnav::arteryMarker(name, id, *surface, stride)); });
}

void cn_ros_send_roadmap(cn_ros *ros, const char *frame, unsigned id, const cn_roadmap *roadmap)
{
    if (roadmap->nedge > 0)
        guarded([&] { ros->roadmap.send(frame, id, catnav::roadmapMarker(id, *roadmap)); });
}

void cn_ros_send_path(cn_ros *ros, const char *frame, const cn_path *path)
{
    guarded([&] { ros->path.send(frame, 0, catnav::toMessage(*path)); });
}

void cn_ros_send_medial_axis(cn_ros *ros, const char *frame, int n, const double *x, const double *clearance)
{
    guarded([&] { ros->medial_axis.send(frame, 0, catnav::cloud(n, x, clearance)); });
}

void cn_ros_forget_arteries(cn_ros *ros)
{
    guarded([&] { ros->artery.forget(removed); });
}

void cn_ros_forget_bodies(cn_ros *ros)
{
    guarded([&] {
        ros->topology.forget();
        ros->catheter.forget(removed);
        ros->roadmap.forget(removed);
        ros->path.forget([](const nav_msgs::Path &old) {
            nav_msgs::Path none;
            none.header = old.header;
            return none;
        });
    });
}
