// ros_tuning.cpp - what may change between plans (dynamic_reconfigure), and diagnostics.
#include <cstdarg>
#include <cstdio>
#include <boost/thread/recursive_mutex.hpp>
#include <catnav/PlanConfig.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <dynamic_reconfigure/server.h>
#include "ros_parts.h"

struct cn_ros_status {
    diagnostic_updater::DiagnosticStatusWrapper &wrapper;
};

void cn_ros_summary(cn_ros_status *status, cn_ros_level level, const char *message)
{
    using diagnostic_msgs::DiagnosticStatus;
    status->wrapper.summary(level == CN_ROS_OK     ? DiagnosticStatus::OK
                            : level == CN_ROS_WARN ? DiagnosticStatus::WARN
                                                   : DiagnosticStatus::ERROR,
                            message);
}

void cn_ros_figure(cn_ros_status *status, const char *key, const char *format, ...)
{
    char value[256];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(value, sizeof value, format, arguments);
    va_end(arguments);
    status->wrapper.add(key, std::string(value));
}

class catnav::Tuning
{
  public:
    explicit Tuning(cn_ros *ros) : ros_(ros), handle_(ros->handle, "settings", topics(ros->handle))
    {
        updater_.setHardwareID("none");
        updater_.add("plan", [this](diagnostic_updater::DiagnosticStatusWrapper &wrapper) {
            cn_ros_status status{wrapper};
            ros_->handlers.status(ros_->handlers.user, &status);
        });
        timer_ = ros->handle.createWallTimer(ros::WallDuration(0.25),
                                             [this](const ros::WallTimerEvent &) { updater_.update(); });
        server_ = std::make_unique<dynamic_reconfigure::Server<PlanConfig>>(lock_, handle_);
        server_->setCallback([this](PlanConfig &c, uint32_t) { onChange(c); });
    }

  private:
    // The parameters lie in ~settings, apart from the scene's options; service and topics where others have
    // them.
    static ros::M_string topics(const ros::NodeHandle &h)
    {
        ros::M_string names;
        for (const char *name : {"set_parameters", "parameter_descriptions", "parameter_updates"})
            names[h.resolveName(std::string("settings/") + name)] = h.resolveName(name);
        return names;
    }

    void onChange(const PlanConfig &c)
    {
        cn_ros_tuning t{};
        t.step = c.step;
        t.time_limit = c.time_limit;
        t.budget = c.planner_budget;
        t.replans = c.planner_replans;
        t.frame_rate = c.frame_rate;
        for (auto &limit : t.limit)
            limit[CN_REDUCE_MAX] = limit[CN_REDUCE_MEAN] = -1;
        t.limit[CN_QUANTITY_VOLUME][CN_REDUCE_MAX] = c.limit_volume_max;
        t.limit[CN_QUANTITY_VOLUME][CN_REDUCE_MEAN] = c.limit_volume_mean;
        t.limit[CN_QUANTITY_STRESS][CN_REDUCE_MAX] = c.limit_stress_max;
        t.limit[CN_QUANTITY_STRESS][CN_REDUCE_MEAN] = c.limit_stress_mean;
        t.limit[CN_QUANTITY_ENERGY][CN_REDUCE_MAX] = c.limit_energy_max;
        t.limit[CN_QUANTITY_WALL_FORCE][CN_REDUCE_MAX] = c.limit_wall_force_max;
        t.limit[CN_QUANTITY_CLEARANCE][CN_REDUCE_MAX] = c.limit_clearance_max;
        ros_->handlers.tune(ros_->handlers.user, &t);
    }

    cn_ros *ros_;
    boost::recursive_mutex lock_;
    ros::NodeHandle handle_;
    std::unique_ptr<dynamic_reconfigure::Server<PlanConfig>> server_;
    diagnostic_updater::Updater updater_{ros::NodeHandle(), ros::NodeHandle("~"),
                                         "/" + ros::this_node::getName()};
    ros::WallTimer timer_;
};

void catnav::End::operator()(Tuning *tuning) const
{
    delete tuning;
}
catnav::Tuning *newTuning(cn_ros *ros)
{
    return new catnav::Tuning(ros);
}
