#include "ros_node.h"

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/ros.h>
#include "convert.h"

namespace
{
using visualization_msgs::Marker;

// A latched publisher that keeps a message per id instead of one: each new subscriber is sent them all.
template <class M> class Latched
{
  public:
    void advertise(ros::NodeHandle &handle, const char *topic)
    {
        publisher_ = handle.advertise<M>(topic, 16, [this](const ros::SingleSubscriberPublisher &subscriber) {
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

Marker removed(const Marker &old)
{
    Marker m;
    m.header = old.header;
    m.ns = old.ns;
    m.id = old.id;
    m.action = Marker::DELETE;
    return m;
}

// No exception crosses into C: what ROS throws is logged.
template <class F> void guarded(F call)
{
    try {
        call();
    } catch (const std::exception &e) {
        ROS_ERROR("%s", e.what());
    }
}
} // namespace

struct cn_ros {
    ros::NodeHandle handle{"~"}, global;
    cn_ros_handlers handlers{};
    Latched<catnav::MeshTopology> topology;
    Latched<Marker> artery, roadmap, catheter;
    Latched<nav_msgs::Path> path;
    Latched<sensor_msgs::PointCloud2> medial_axis;
    ros::Publisher state, diagnostics;
    ros::Subscriber mesh;
    ros::ServiceServer plan;
    ros::WallTimer timer;
    std::unique_ptr<ros::AsyncSpinner> spinner;

    void onMesh(const catnav::SurfaceMesh::ConstPtr &message)
    {
        const cn_ros_mesh view = catnav::view(*message);
        handlers.mesh(handlers.user, &view);
    }
    bool onPlan(catnav::PlanCatheter::Request &request, catnav::PlanCatheter::Response &response)
    {
        const catnav::RequestView view(request);
        cn_ros_answer answer{};
        handlers.plan(handlers.user, &view.request, &answer);

        response.verdict = catnav::toMessage(answer.report.verdict);
        if (answer.path) response.path = catnav::toMessage(*answer.path);
        response.path.header.frame_id = answer.frame;
        response.path.header.stamp = ros::Time::now();
        for (auto &pose : response.path.poses)
            pose.header = response.path.header;
        response.steps = uint32_t(answer.report.steps);
        response.replans = uint32_t(answer.report.replans);
        const double gap = answer.report.contact.gap_min;
        response.gap_min = std::isfinite(gap) ? gap : 0;
        if (char *json = cn_report_json(&answer.report)) {
            response.report_json = json;
            free(json);
        }
        cn_path_free(answer.path);
        cn_report_clear(&answer.report);
        return true;
    }
};

cn_status cn_ros_new(cn_ros **out, int argc, char **argv, const char *name, const volatile sig_atomic_t *stop,
                     cn_error *error)
{
    *out = nullptr;
    try {
        ros::init(argc, argv, name, ros::init_options::NoSigintHandler);
        while (!ros::master::check()) {
            if (*stop)
                return cn_fail(error, CN_ERR_CANCELLED, "", 0, "stopped while waiting for the ROS master");
            ros::WallDuration(0.1).sleep();
        }
        *out = new cn_ros;
        return CN_OK;
    } catch (const std::exception &e) {
        return cn_fail(error, CN_ERR_ARG, "", 0, "ROS cannot be started: %s", e.what());
    }
}

cn_status cn_ros_start(cn_ros *ros, const cn_ros_handlers *handlers, cn_error *error)
{
    try {
        auto &h = ros->handle;
        ros->handlers = *handlers;
        ros->topology.advertise(h, "catheter_topology");
        ros->catheter.advertise(h, "catheter_marker");
        ros->artery.advertise(h, "artery_marker");
        ros->roadmap.advertise(h, "roadmap_marker");
        ros->path.advertise(h, "path");
        ros->medial_axis.advertise(h, "medial_axis");
        ros->state = h.advertise<catnav::MeshState>("catheter_mesh", 64);
        ros->diagnostics = ros->global.advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", 8);
        ros->timer = h.createWallTimer(ros::WallDuration(1), [ros](const ros::WallTimerEvent &) {
            ros->handlers.tick(ros->handlers.user);
        });
        ros->mesh = h.subscribe("artery_mesh", 8, &cn_ros::onMesh, ros);
        ros->plan = h.advertiseService("plan", &cn_ros::onPlan, ros);
        ros->spinner = std::make_unique<ros::AsyncSpinner>(4); // one may plan, one check a mesh, two answer
        ros->spinner->start();
        return CN_OK;
    } catch (const std::exception &e) {
        return cn_fail(error, CN_ERR_ARG, "", 0, "topics or service cannot be opened: %s", e.what());
    }
}

bool cn_ros_ok(const cn_ros *)
{
    return ros::ok();
}
bool cn_ros_mesh_senders(const cn_ros *ros)
{
    return ros->mesh.getNumPublishers() > 0;
}

void cn_ros_free(cn_ros *ros)
{
    if (!ros) return;
    guarded([&] {
        if (ros->spinner) ros->spinner->stop();
        ros::WallDuration(0.1).sleep(); // roscpp writes the last answer from a thread of its own
        ros::shutdown();
    });
    delete ros;
}

void cn_ros_log(cn_log_level level, const char *file, int line, const char *text)
{
    switch (level) {
    case CN_LOG_DEBUG:
        ROS_DEBUG("%s (%s:%d)", text, file, line);
        break;
    case CN_LOG_INFO:
        ROS_INFO("%s", text);
        break;
    case CN_LOG_WARNING:
        ROS_WARN("%s", text);
        break;
    default:
        ROS_ERROR("%s", text);
    }
}

void cn_ros_text(const cn_ros *ros, const char *key, const char *otherwise, char *out, size_t size)
{
    std::string value = otherwise;
    guarded([&] { ros->handle.getParam(key, value); });
    snprintf(out, size, "%s", value.c_str());
}

double cn_ros_number(const cn_ros *ros, const char *key, double otherwise)
{
    double value = otherwise;
    guarded([&] { ros->handle.getParam(key, value); });
    return value;
}

// A parameter as YAML: scalars plain, lists and what they hold in flow style.
static std::string yaml(XmlRpc::XmlRpcValue &v)
{
    std::ostringstream text;
    text.precision(17);
    switch (v.getType()) {
    case XmlRpc::XmlRpcValue::TypeBoolean:
        text << (bool(v) ? "true" : "false");
        break;
    case XmlRpc::XmlRpcValue::TypeInt:
        text << int(v);
        break;
    case XmlRpc::XmlRpcValue::TypeDouble:
        text << double(v);
        break;
    case XmlRpc::XmlRpcValue::TypeString:
        text << std::string(v);
        break;
    case XmlRpc::XmlRpcValue::TypeArray:
        text << "[";
        for (int i = 0; i < v.size(); i++)
            text << (i ? ", " : "") << yaml(v[i]);
        text << "]";
        break;
    case XmlRpc::XmlRpcValue::TypeStruct:
        text << "{";
        for (auto i = v.begin(); i != v.end(); ++i)
            text << (i == v.begin() ? "" : ", ") << i->first << ": " << yaml(i->second);
        text << "}";
        break;
    default:
        break;
    }
    return text.str();
}

static void flatten(const std::string &prefix, XmlRpc::XmlRpcValue &v,
                    std::map<std::string, std::string> &out)
{
    if (v.getType() != XmlRpc::XmlRpcValue::TypeStruct) {
        out[prefix] = yaml(v);
        return;
    }
    for (auto &entry : v)
        flatten(prefix.empty() ? entry.first : prefix + "." + entry.first, entry.second, out);
}

cn_status cn_ros_settings(const cn_ros *ros, const char *const *except, int *n, cn_setting **out)
{
    std::map<std::string, std::string> all;
    guarded([&] {
        XmlRpc::XmlRpcValue value;
        if (ros->global.getParam(ros->handle.getNamespace(), value)) flatten("", value, all);
    });
    for (; *except; except++)
        all.erase(*except);
    all.erase("");

    *n = 0;
    *out = static_cast<cn_setting *>(calloc(all.size() + 1, sizeof **out));
    if (!*out) return CN_ERR_MEMORY;
    for (const auto &entry : all) {
        cn_setting &setting = (*out)[(*n)++];
        setting.key = strdup(entry.first.c_str());
        setting.value = strdup(entry.second.c_str());
        if (!setting.key || !setting.value) {
            cn_ros_settings_free(*n, *out);
            *n = 0, *out = nullptr;
            return CN_ERR_MEMORY;
        }
    }
    return CN_OK;
}

void cn_ros_settings_free(int n, cn_setting *setting)
{
    for (int i = 0; i < n; i++) {
        free(const_cast<char *>(setting[i].key));
        free(const_cast<char *>(setting[i].value));
    }
    free(setting);
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
                          int ntri, const int *tri, const double *x, const float *stress, double full)
{
    guarded([&] {
        ros->catheter.send(frame, id, catnav::catheterMarker(name, id, nactive, ntri, tri, x, stress, full));
    });
}

void cn_ros_send_artery(cn_ros *ros, const char *frame, const char *name, unsigned id,
                        const cn_surface *surface)
{
    guarded([&] { ros->artery.send(frame, id, catnav::arteryMarker(name, id, *surface)); });
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

void cn_ros_send_diagnostics(cn_ros *ros, bool ok, const char *message, int nfigure,
                             const cn_ros_figure *figure)
{
    guarded([&] {
        diagnostic_msgs::DiagnosticArray array;
        diagnostic_msgs::DiagnosticStatus status;
        status.level = ok ? diagnostic_msgs::DiagnosticStatus::OK : diagnostic_msgs::DiagnosticStatus::WARN;
        status.name = ros::this_node::getName() + ": plan";
        status.hardware_id = "none";
        status.message = message;
        for (int i = 0; i < nfigure; i++) {
            diagnostic_msgs::KeyValue pair;
            pair.key = figure[i].key;
            pair.value = figure[i].value;
            status.values.push_back(pair);
        }
        array.header.stamp = ros::Time::now();
        array.status.push_back(status);
        ros->diagnostics.publish(array);
    });
}
