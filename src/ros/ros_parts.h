// ros_parts.h - what the files behind ros_node.h share.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <tf2_ros/transform_listener.h>
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

class PlanDoor; // ~plan and ~plan_action: calls by number, from request to answer (ros_plan.cpp)
class Marks;    // waypoints by mouse (ros_marks.cpp)
class Tuning;   // run-time settings and diagnostics (ros_tuning.cpp)
struct End {
    void operator()(PlanDoor *door) const;
    void operator()(Marks *marks) const;
    void operator()(Tuning *tuning) const;
};
struct Frames {
    tf2_ros::Buffer buffer;
    tf2_ros::TransformListener listener{buffer};
};
} // namespace catnav

struct cn_ros_message {
    catnav::WireMesh::ConstPtr mesh;
};

struct cn_ros {
    ros::NodeHandle handle{"~"}, global;
    cn_ros_handlers handlers{};
    catnav::Latched<catnav::MeshTopology> topology;
    catnav::Latched<visualization_msgs::Marker> artery, roadmap, catheter;
    catnav::Latched<nav_msgs::Path> path;
    catnav::Latched<sensor_msgs::PointCloud2> medial_axis;
    ros::Publisher state;
    ros::Subscriber mesh;
    ros::WallTimer feedback;
    std::unique_ptr<catnav::Frames> frames;
    std::unique_ptr<catnav::PlanDoor, catnav::End> plan;
    std::unique_ptr<catnav::Marks, catnav::End> marks;
    std::unique_ptr<catnav::Tuning, catnav::End> tuning;
    std::unique_ptr<ros::AsyncSpinner> spinner;
    std::map<int, std::pair<uint32_t, uint32_t>>
        told;                            // messages and drops of each connection, when last asked
    unsigned long came = 0, dropped = 0; // of all there have been
};

catnav::PlanDoor *newPlanDoor(cn_ros *ros, int waiting);
void stopPlanDoor(catnav::PlanDoor &door); // every call has been answered
catnav::Marks *newMarks(cn_ros *ros);
catnav::Tuning *newTuning(cn_ros *ros);
void advertiseShow(cn_ros *ros); // ros_show.cpp
