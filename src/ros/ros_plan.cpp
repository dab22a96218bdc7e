// ros_plan.cpp - ~plan (a service) and ~plan_action (an action): calls by number, from request to answer.
#include <cmath>
#include <condition_variable>
#include <cstdlib>
#include "ros_action.h"
#include "ros_parts.h"

using catnav::guarded;

class catnav::PlanDoor
{
    using Server = catnav::ActionServer;

    // Lives from its request to cn_ros_end_call, a service's also until its answer has been handed to roscpp.
    struct Call {
        std::unique_ptr<RequestView> view; // points into one of the next two
        PlanCatheter::Request request;
        Server::GoalHandle goal;
        bool action = false, answered = false;
        PlanCatheter::Response response;
    };

  public:
    PlanDoor(cn_ros *ros, int waiting)
        : ros_(ros),
          // each call of the service holds a thread: one is served, some wait, one is being refused
          spinner_(uint32_t(waiting + 2), &queue_)
    {
        server_ = std::make_unique<Server>(
            ros->handle, "plan_action", ros->gaps, [this](Server::GoalHandle g) { onGoal(g); },
            [this](Server::GoalHandle g) { onCancel(g); });
        ros::NodeHandle handle(ros->handle);
        handle.setCallbackQueue(&queue_);
        service_ = handle.advertiseService("plan", &PlanDoor::onService, this);
        spinner_.start();
    }
    // The node has answered every call.
    void stop() { spinner_.stop(); }

    void begin(cn_ros_call number)
    {
        if (auto call = find(number))
            if (call->action) call->goal.setAccepted();
    }

    void feedback(cn_ros_call number, const PlanCatheterFeedback &feedback)
    {
        if (auto call = find(number))
            if (call->action) call->goal.publishFeedback(feedback);
    }

    void answer(cn_ros_call number, const cn_ros_answer &answer)
    {
        auto call = find(number);
        if (!call) return;
        if (!call->action) {
            toMessage(answer, call->response);
            std::lock_guard<std::mutex> guard(lock_);
            call->answered = true;
            answered_.notify_all();
            return;
        }
        PlanCatheterResult result;
        toMessage(answer, result);
        const std::string &text = result.verdict.message;
        const auto status = call->goal.getGoalStatus().status;
        switch (answer.report.verdict.code) {
        case CN_VERDICT_REACHED:
        case CN_VERDICT_RAN:
            call->goal.setSucceeded(result, text);
            break;
        case CN_VERDICT_CANCELLED:
            call->goal.setCanceled(result, text);
            break;
        default:
            if (status == actionlib_msgs::GoalStatus::PENDING ||
                status == actionlib_msgs::GoalStatus::RECALLING)
                call->goal.setRejected(result, text);
            else
                call->goal.setAborted(result, text);
        }
    }

    void end(cn_ros_call number)
    {
        std::lock_guard<std::mutex> guard(lock_);
        calls_.erase(number);
    }

  private:
    std::shared_ptr<Call> find(cn_ros_call number)
    {
        std::lock_guard<std::mutex> guard(lock_);
        const auto found = calls_.find(number);
        return found == calls_.end() ? nullptr : found->second;
    }
    cn_ros_call add(const std::shared_ptr<Call> &call)
    {
        std::lock_guard<std::mutex> guard(lock_);
        calls_[++last_] = call;
        return last_;
    }

    bool onService(PlanCatheter::Request &request, PlanCatheter::Response &response)
    {
        auto call = std::make_shared<Call>();
        call->request = std::move(request);
        call->view = std::make_unique<RequestView>(call->request);
        ros_->handlers.plan(ros_->handlers.user, add(call), &call->view->request);
        std::unique_lock<std::mutex> lock(lock_);
        answered_.wait(lock, [&] { return call->answered; });
        response = std::move(call->response);
        return true;
    }
    void onGoal(Server::GoalHandle goal)
    {
        auto call = std::make_shared<Call>();
        call->action = true;
        call->goal = goal;
        call->view = std::make_unique<RequestView>(*goal.getGoal()); // the handle keeps the goal
        const cn_ros_call number = add(call);
        ros_->handlers.plan(ros_->handlers.user, number, &call->view->request);
        const auto status = goal.getGoalStatus().status; // its cancel may have come before it had a number
        if (status == actionlib_msgs::GoalStatus::RECALLING ||
            status == actionlib_msgs::GoalStatus::PREEMPTING)
            ros_->handlers.cancel(ros_->handlers.user, number);
    }
    void onCancel(Server::GoalHandle goal)
    {
        cn_ros_call number = 0;
        {
            std::lock_guard<std::mutex> guard(lock_);
            for (const auto &entry : calls_)
                if (entry.second->action && entry.second->goal == goal) number = entry.first;
        }
        if (number) ros_->handlers.cancel(ros_->handlers.user, number);
    }

    cn_ros *ros_;
    std::mutex lock_;
    std::condition_variable answered_;
    std::map<cn_ros_call, std::shared_ptr<Call>> calls_;
    cn_ros_call last_ = 0;
    std::unique_ptr<Server> server_;
    ros::CallbackQueue queue_;
    ros::ServiceServer service_;
    ros::AsyncSpinner spinner_;
};

void catnav::End::operator()(PlanDoor *door) const
{
    delete door;
}
catnav::PlanDoor *newPlanDoor(cn_ros *ros, int waiting)
{
    return new catnav::PlanDoor(ros, waiting);
}
void stopPlanDoor(catnav::PlanDoor &door)
{
    door.stop();
}

void cn_ros_begin_call(cn_ros *ros, cn_ros_call call)
{
    guarded([&] { ros->plan->begin(call); });
}

void cn_ros_send_feedback(cn_ros *ros, cn_ros_call call, const cn_progress *progress, const char *stage,
                          double real_time_factor, int nmargin, const cn_ros_margin *margin)
{
    guarded([&] {
        ros->plan->feedback(call, catnav::feedback(*progress, stage, real_time_factor, nmargin, margin));
    });
}

void cn_ros_send_answer(cn_ros *ros, cn_ros_call call, cn_ros_answer *answer)
{
    guarded([&] { ros->plan->answer(call, *answer); });
    cn_ros_answer_clear(answer);
}

void cn_ros_end_call(cn_ros *ros, cn_ros_call call)
{
    ros->plan->end(call);
}

void cn_ros_answer_clear(cn_ros_answer *answer)
{
    free(answer->json);
    cn_path_free(answer->path);
    cn_report_clear(&answer->report);
    *answer = cn_ros_answer{};
}
