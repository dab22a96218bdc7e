// ros_marks.cpp - waypoints by mouse: /clicked_point, interactive markers with their menu, files by service.
#include <cstdlib>
#include <geometry_msgs/PointStamped.h>
#include <interactive_markers/interactive_marker_server.h>
#include <interactive_markers/menu_handler.h>
#include <catnav/WaypointsFile.h>
#include "ros_parts.h"

using visualization_msgs::InteractiveMarker;
using visualization_msgs::InteractiveMarkerControl;
using visualization_msgs::InteractiveMarkerFeedback;
using visualization_msgs::Marker;

class catnav::Marks
{
    using File = void (*)(void *, const char *, cn_ros_file_reply *);

  public:
    explicit Marks(cn_ros *ros) : ros_(ros), server_(ros->handle.getNamespace() + "/waypoints")
    {
        const std::pair<const char *, cn_ros_mark_event> entries[] = {
            {"Plan through the waypoints", CN_ROS_MARK_PLAN},
            {"Insert a waypoint after this", CN_ROS_MARK_INSERT},
            {"Onto the medial axis", CN_ROS_MARK_SNAP},
            {"Delete", CN_ROS_MARK_DELETE},
            {"Delete all", CN_ROS_MARK_CLEAR}};
        for (const auto &entry : entries) {
            const cn_ros_mark_event event = entry.second;
            menu_.insert(entry.first, [this, event](const InteractiveMarkerFeedback::ConstPtr &f) {
                send(event, *f, false);
            });
        }
        click_ = ros->gaps.subscribe<geometry_msgs::PointStamped>(
            clicks_, "/clicked_point", 16, [this](const geometry_msgs::PointStamped::ConstPtr &m) {
                ros_->handlers.click(ros_->handlers.user, m->header.frame_id.c_str(), &m->point.x);
            });
        save_ = file("save_waypoints", ros->handlers.save);
        load_ = file("load_waypoints", ros->handlers.load);
    }

    void show(const char *frame, int n, const double *x, const char *const *why, double size)
    {
        std::lock_guard<std::mutex> guard(lock_);
        for (int i = n; i < shown_; i++)
            server_.erase("waypoint " + std::to_string(i));
        for (int i = 0; i < n; i++) {
            server_.insert(mark(frame, i, i + 1 == n, x + 3 * i, why[i], size),
                           [this](const InteractiveMarkerFeedback::ConstPtr &f) { onFeedback(*f); });
            menu_.apply(server_, "waypoint " + std::to_string(i));
        }
        shown_ = n;
        server_.applyChanges();
    }

  private:
    ros::ServiceServer file(const char *name, File handler)
    {
        return ros_->handle.advertiseService<WaypointsFile::Request, WaypointsFile::Response>(
            name, [this, handler](WaypointsFile::Request &request, WaypointsFile::Response &response) {
                const auto reply = std::make_unique<cn_ros_file_reply>();
                handler(ros_->handlers.user, request.scene.c_str(), reply.get());
                response.success = reply->success;
                response.message = reply->message;
                for (int i = 0; i < reply->nwaypoint; i++)
                    response.waypoints.push_back(point(reply->waypoint + 3 * i));
                return true;
            });
    }

    void onFeedback(const InteractiveMarkerFeedback &f)
    {
        if (f.event_type == InteractiveMarkerFeedback::POSE_UPDATE) send(CN_ROS_MARK_DRAGGED, f, true);
        if (f.event_type == InteractiveMarkerFeedback::MOUSE_UP) send(CN_ROS_MARK_DROPPED, f, true);
    }
    void send(cn_ros_mark_event event, const InteractiveMarkerFeedback &f, bool with_point)
    {
        const int at = f.marker_name.size() > 9 ? atoi(f.marker_name.c_str() + 9) : -1; // "waypoint 3"
        ros_->handlers.mark(ros_->handlers.user, event, at, f.header.frame_id.c_str(),
                            with_point ? &f.pose.position.x : nullptr);
    }

    static InteractiveMarker mark(const char *frame, int i, bool last, const double *x, const char *why,
                                  double size)
    {
        const bool good = !why[0];
        InteractiveMarker m;
        m.header.frame_id = frame;
        m.name = "waypoint " + std::to_string(i);
        m.description = i == 0 ? "entry" : last ? "target" : std::to_string(i);
        if (!good) m.description += ": " + std::string(why);
        m.scale = float(5 * size);
        m.pose.position = point(x);
        m.pose.orientation.w = 1;

        Marker ball = marker("", 0, Marker::SPHERE);
        ball.scale.x = ball.scale.y = ball.scale.z = 2 * size;
        ball.color.r = good ? 0.1f : 0.9f, ball.color.g = good ? 0.7f : 0.1f,
        ball.color.b = good ? 0.3f : 0.1f;
        InteractiveMarkerControl grip;
        grip.name = "grip";
        grip.interaction_mode = InteractiveMarkerControl::MOVE_3D;
        grip.always_visible = true;
        grip.markers.push_back(ball);
        m.controls.push_back(grip);
        const double half = std::sqrt(0.5); // quaternions that turn x into x, z and y
        const double turns[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
        for (int k = 0; k < 3; k++) {
            InteractiveMarkerControl axis;
            axis.name = std::string("move ") + "xzy"[k];
            axis.interaction_mode = InteractiveMarkerControl::MOVE_AXIS;
            axis.orientation.w = half;
            axis.orientation.x = half * turns[k][0];
            axis.orientation.y = half * turns[k][1];
            axis.orientation.z = half * turns[k][2];
            m.controls.push_back(axis);
        }
        return m;
    }

    cn_ros *ros_;
    std::mutex lock_;
    int shown_ = 0;
    interactive_markers::InteractiveMarkerServer server_;
    interactive_markers::MenuHandler menu_;
    ros::NodeHandle clicks_;
    Lane click_lane_{clicks_};
    ros::Subscriber click_;
    ros::ServiceServer save_, load_;
};

void catnav::End::operator()(Marks *marks) const
{
    delete marks;
}
catnav::Marks *newMarks(cn_ros *ros)
{
    return new catnav::Marks(ros);
}

void cn_ros_send_marks(cn_ros *ros, const char *frame, int n, const double *x, const char *const *why,
                       double size)
{
    catnav::guarded([&] { ros->marks->show(frame, n, x, why, size); });
}
