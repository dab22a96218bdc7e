// ros_parts.h - what the files behind ros_node.h share.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include "convert.h"
#include "ros_node.h"

namespace catnav
{
// No exception crosses into C: what ROS throws is logged.
template <class F> void guarded(F call)
{
    try {
        call();
    } catch (const std::exception &e) {
        ROS_ERROR("%s", e.what());
    }
}

// A latched publisher that keeps a message per id instead of one: each new subscriber is sent them all.
template <class M> class Latched
{
  public:
    void advertise(ros::NodeHandle &handle, const char *topic)
    {
        publisher_ = handle.advertise<M>(topic, 64, [this](const ros::SingleSubscriberPublisher &subscriber) {
            std::lock_guard<std::mutex> guard(lock_);
            for (const auto &entry : last_)
                subscriber.publish(*entry.second);
        });
    }
    void send(const char *frame, unsigned id, M message)
    {
        message.header.frame_id = frame;
        message.header.stamp = ros::Time::now();
        auto shared = boost::make_shared<const M>(std::move(message));
        std::lock_guard<std::mutex> guard(lock_);
        last_[id] = shared;
        publisher_.publish(shared);
    }
    // Forgets all; `remove` turns a message into the one that takes it off the screen.
    template <class Remove> void forget(Remove remove)
    {
        std::lock_guard<std::mutex> guard(lock_);
        for (const auto &entry : last_)
            publisher_.publish(remove(*entry.second));
        last_.clear();
    }
    void forget()
    {
        std::lock_guard<std::mutex> guard(lock_);
        last_.clear();
    }

  private:
    std::mutex lock_;
    std::map<unsigned, boost::shared_ptr<const M>> last_;
    ros::Publisher publisher_;
};

// ~plan and ~plan_action: calls by number, from their request to their answer (ros_plan.cpp).
class PlanDoor;
struct PlanDoorEnd {
    void operator()(PlanDoor *door) const;
};
} // namespace catnav

struct cn_ros {
    ros::NodeHandle handle{"~"}, global;
    cn_ros_handlers handlers{};
    catnav::Latched<catnav::MeshTopology> topology;
    catnav::Latched<visualization_msgs::Marker> artery, roadmap, catheter;
    catnav::Latched<nav_msgs::Path> path;
    catnav::Latched<sensor_msgs::PointCloud2> medial_axis;
    ros::Publisher state, diagnostics;
    ros::Subscriber mesh;
    ros::WallTimer tick, feedback;
    std::unique_ptr<catnav::PlanDoor, catnav::PlanDoorEnd> plan;
    std::unique_ptr<ros::AsyncSpinner> spinner;
};

// What starts, and what `stop` ends: no callback runs any more.
catnav::PlanDoor *newPlanDoor(cn_ros *ros, int waiting);
void stopPlanDoor(catnav::PlanDoor &door);
void advertiseShow(cn_ros *ros); // ros_show.cpp
