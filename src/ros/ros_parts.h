// ros_parts.h - what the files behind ros_node.h share.
#pragma once

#include <cstring>
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

// A queue of callbacks with a thread of its own, for topics that others may flood: of several threads of one
// queue all but the one that is in a topic's callback ask for the next again and again, without a pause.
struct Lane {
    ros::CallbackQueue queue;
    ros::AsyncSpinner spinner{1, &queue};
    // The handle's subscriptions from now on are served here.
    explicit Lane(ros::NodeHandle &handle)
    {
        handle.setCallbackQueue(&queue);
        spinner.start();
    }
};

// roscpp and rospy number what a publisher sends in header.seq: a gap is what was sent and never looked at,
// for the sender's queue or our own was full. A first number, the same again and a lower one (a sender anew)
// are no gap.
class Gaps
{
  public:
    // Calls back with each message once its number has been looked at.
    template <class M, class F>
    ros::Subscriber subscribe(ros::NodeHandle &handle, const char *topic, uint32_t queue, F call)
    {
        const boost::function<void(const ros::MessageEvent<const M> &)> look_and_call =
            [this, topic, call](const ros::MessageEvent<const M> &event) {
                look(topic + (" " + event.getPublisherName()), number(*event.getConstMessage()));
                call(event.getConstMessage());
            };
        return handle.subscribe<M, const ros::MessageEvent<const M> &>(topic, queue, look_and_call);
    }
    unsigned long missing() const
    {
        std::lock_guard<std::mutex> guard(lock_);
        return missing_;
    }

  private:
    static constexpr size_t most = 1024; // senders remembered; all are forgotten when there are more

    template <class M> static uint32_t number(const M &message) { return message.header.seq; }
    static uint32_t number(const WireMesh &mesh)
    {
        uint32_t seq = 0; // a mesh begins with it
        if (mesh.bytes.size() >= sizeof seq) memcpy(&seq, mesh.bytes.data(), sizeof seq);
        return seq;
    }
    void look(const std::string &sender, uint32_t seq)
    {
        std::lock_guard<std::mutex> guard(lock_);
        if (last_.size() >= most) last_.clear();
        const auto found = last_.emplace(sender, seq).first;
        const uint32_t step = seq - found->second; // numbers begin anew after the last there is
        if (step > 0 && step < UINT32_C(1) << 31) missing_ += step - 1;
        found->second = seq;
    }

    mutable std::mutex lock_;
    std::map<std::string, uint32_t> last_; // number by topic and sender
    unsigned long missing_ = 0;
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
    catnav::Gaps gaps;
    ros::NodeHandle mesh_handle{"~"};
    catnav::Lane mesh_lane{mesh_handle};
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
