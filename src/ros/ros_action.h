// ros_action.h - the action's server: actionlib's rules for goals, with a status list that stays short.
#pragma once

#include <algorithm>
#include <actionlib/server/action_server_base.h>
#include <catnav/PlanCatheterAction.h>
#include "ros_parts.h"

namespace catnav
{
// Lets its thread pass so often a second, and `burst` times at once where it was not called for a while.
class Pace
{
  public:
    Pace(double rate, double burst) : between_(1 / rate), stock_(burst / rate) {}
    void keep()
    {
        const double now = ros::WallTime::now().toSec();
        next_ = std::max(next_, now - stock_) + between_;
        if (next_ > now) ros::WallDuration(next_ - now).sleep();
    }

  private:
    const double between_, stock_; // [s]
    double next_ = 0;
};

// Where actionlib::ActionServer keeps the cancels of goals that never come for ever, and sends the whole list
// at every change, this one forgets and waits: so that a flood of goals and cancels costs what a few do. A
// goal whose cancel overtook it is answered with a verdict too.
class ActionServer : public actionlib::ActionServerBase<PlanCatheterAction>
{
    using Base = actionlib::ActionServerBase<PlanCatheterAction>;

  public:
    using Callback = boost::function<void(GoalHandle)>;
    ActionServer(const ros::NodeHandle &handle, const std::string &name, Gaps &gaps, Callback goal,
                 Callback cancel)
        : Base(goal, cancel, false), gaps_(gaps), node_(handle, name), goals_(node_), cancels_(node_)
    {
        start();
    }

  private:
    static constexpr double rate = 200; // [1/s]: goals looked at; more than that waits, then drops
    // What has ended stays in the status list for so long [s] where there is more than `kept` of it: a client
    // whose goal leaves the list before it has read the result takes it for lost. Never more than `most`.
    static constexpr double seen = 2;
    static constexpr size_t kept = 128, most = 1024;
    static constexpr size_t kept_cancels = 64;  // of goals that have not come
    static constexpr double between = 0.02;     // [s]: two status messages
    static constexpr double status_rate = 10.0; // [1/s]

    void initialize() override
    {
        result_ = node_.advertise<PlanCatheterActionResult>("result", 64);
        feedback_ = node_.advertise<PlanCatheterActionFeedback>("feedback", 16);
        status_ = node_.advertise<actionlib_msgs::GoalStatusArray>("status", 2, true);
        status_list_timeout_ = ros::Duration(node_.param("status_list_timeout", 5.0));
        timer_ =
            node_.createWallTimer(ros::WallDuration(1 / status_rate), [this](const ros::WallTimerEvent &) {
                boost::recursive_mutex::scoped_lock lock(lock_);
                told_ = ros::WallTime();
                if (started_) publishStatus();
            });
        goal_ = gaps_.subscribe<PlanCatheterActionGoal>(goals_, "goal", 64,
                                                        [this](const PlanCatheterActionGoal::ConstPtr &m) {
                                                            pace_.keep();
                                                            goalCallback(m);
                                                        });
        cancel_ = cancels_.subscribe<actionlib_msgs::GoalID>(
            "cancel", 64, [this](const actionlib_msgs::GoalID::ConstPtr &m) { onCancel(m); });
    }

    void onCancel(const actionlib_msgs::GoalID::ConstPtr &message)
    {
        cancelCallback(message);
        boost::recursive_mutex::scoped_lock lock(lock_);
        for (auto i = status_list_.rbegin(); i != status_list_.rend(); ++i) { // one for a goal yet to come
            if (i->status_.status != actionlib_msgs::GoalStatus::RECALLING) break;
            if (i->handle_tracker_.expired() && i->handle_destruction_time_.isZero())
                i->handle_destruction_time_ = ros::Time::now();
        }
        forget();
    }

    // What ended long ago, and what ended a while ago where there is much of it. The list is in the order of
    // coming, which is not that of ending.
    void forget()
    {
        const auto is_cancel = [](const auto &entry) {
            return entry.status_.status == actionlib_msgs::GoalStatus::RECALLING;
        };
        const ros::Time now = ros::Time::now();
        size_t cancels = size_t(std::count_if(status_list_.begin(), status_list_.end(), is_cancel));
        size_t goals = status_list_.size() - cancels;
        for (auto i = status_list_.begin(); i != status_list_.end();) {
            const bool ended = i->handle_tracker_.expired() && !i->handle_destruction_time_.isZero();
            const ros::Duration past = now - i->handle_destruction_time_;
            const bool many = is_cancel(*i) ? cancels > kept_cancels
                                            : goals > most || (goals > kept && past > ros::Duration(seen));
            if (ended) i->goal_.reset();
            if (!ended || !(many || past > status_list_timeout_)) {
                ++i;
                continue;
            }
            (is_cancel(*i) ? cancels : goals)--;
            i = status_list_.erase(i);
        }
    }

    void publishResult(const actionlib_msgs::GoalStatus &status, const Result &result) override
    {
        boost::recursive_mutex::scoped_lock lock(lock_);
        PlanCatheterActionResult message;
        message.header.stamp = ros::Time::now();
        message.status = status;
        message.result = result;
        auto &verdict = message.result.verdict;
        if (verdict.code == Verdict::UNKNOWN) {
            verdict.code = Verdict::CANCELLED;
            verdict.message = "cancelled before it came";
            verdict.element = verdict.step = verdict.waypoint = -1;
        }
        result_.publish(message);
        publishStatus();
    }

    void publishFeedback(const actionlib_msgs::GoalStatus &status, const Feedback &feedback) override
    {
        PlanCatheterActionFeedback message;
        message.header.stamp = ros::Time::now();
        message.status = status;
        message.feedback = feedback;
        { // a client that cancels a goal which no status has named yet takes the next list without it for its
          // end
            boost::recursive_mutex::scoped_lock lock(lock_);
            if (held_) told_ = ros::WallTime(), publishStatus();
        }
        feedback_.publish(message);
    }

    // At most every `between`: the timer, or what a goal has to tell first, brings what was held back.
    void publishStatus() override
    {
        boost::recursive_mutex::scoped_lock lock(lock_);
        const ros::WallTime now = ros::WallTime::now();
        held_ = now - told_ < ros::WallDuration(between);
        if (held_) return;
        told_ = now;
        forget();
        actionlib_msgs::GoalStatusArray message;
        message.header.stamp = ros::Time::now();
        for (const auto &entry : status_list_)
            message.status_list.push_back(entry.status_);
        status_.publish(message);
    }

    Pace pace_{rate, 64};
    Gaps &gaps_;
    ros::NodeHandle node_, goals_, cancels_;
    Lane goal_lane_{goals_}, cancel_lane_{cancels_};
    ros::Publisher result_, feedback_, status_;
    ros::Subscriber goal_, cancel_;
    ros::WallTimer timer_;
    ros::WallTime told_;
    bool held_ = false; // the list has changed since
};
} // namespace catnav
