// ros_node.cpp - the node's life in ROS: start, parameters, threads, end.
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <SuiteSparse_config.h>
#include <ros/network.h>
#include <ros/xmlrpc_manager.h>
#include "ros_parts.h"

using catnav::guarded;

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

cn_status cn_ros_start(cn_ros *ros, const cn_ros_handlers *handlers, int waiting, cn_error *error)
{
    try {
        auto &h = ros->handle;
        ros->handlers = *handlers;
        advertiseShow(ros);
        ros->feedback = h.createWallTimer(ros::WallDuration(0.1), [ros](const ros::WallTimerEvent &) {
            ros->handlers.feedback(ros->handlers.user);
        });
        ros->frames = std::make_unique<catnav::Frames>();
        ros->marks.reset(newMarks(ros));
        ros->plan.reset(newPlanDoor(ros, waiting));
        ros->tuning.reset(newTuning(ros));
        ros->mesh = ros->gaps.subscribe<catnav::WireMesh>(
            ros->mesh_handle, "artery_mesh", 8, [ros](const catnav::WireMesh::ConstPtr &message) {
                ros->handlers.mesh(ros->handlers.user, new cn_ros_message{message});
            });
        ros->spinner = std::make_unique<ros::AsyncSpinner>(4); // none of the callbacks takes long
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

// What roscpp counts it tells over ROS's own interface alone.
static bool busStats(XmlRpc::XmlRpcValue &stats)
{
    const auto &manager = ros::XMLRPCManager::instance();
    XmlRpc::XmlRpcValue name, answer;
    std::string host;
    uint32_t port;
    if (!ros::network::splitURI(manager->getServerURI(), host, port)) return false;
    XmlRpc::XmlRpcClient *client = manager->getXMLRPCClient(host, int(port), "/");
    name[0] = ros::this_node::getName();
    const bool told = client->execute("getBusStats", name, answer);
    manager->releaseXMLRPCClient(client);
    stats = told && answer.size() == 3 ? answer[2] : answer; // some roscpp leave out code and text
    return told && stats.size() >= 2;
}

void cn_ros_traffic(cn_ros *ros, unsigned long *came, unsigned long *dropped, unsigned long *missing)
{
    guarded([&] {
        XmlRpc::XmlRpcValue stats;
        std::map<int, std::pair<uint32_t, uint32_t>> now;
        if (!busStats(stats)) return;
        for (int i = 0; i < stats[1].size(); i++) {
            auto &connections = stats[1][i][1]; // id, bytes, messages, drops
            for (int k = 0; k < connections.size(); k++)
                now[int(connections[k][0])] = {uint32_t(int(connections[k][2])),
                                               uint32_t(int(connections[k][3]))};
        }
        for (const auto &one : now) {
            const auto before = ros->told[one.first]; // of a new one: nothing
            ros->came += one.second.first - before.first, ros->dropped += one.second.second - before.second;
        }
        ros->told = std::move(now);
    });
    *came = ros->came, *dropped = ros->dropped, *missing = ros->gaps.missing();
}

void cn_ros_free(cn_ros *ros)
{
    if (!ros) return;
    guarded([&] {
        if (ros->plan) stopPlanDoor(*ros->plan);
        if (ros->spinner) ros->spinner->stop();
        ros->handle.deleteParam("settings"); // what was set while it ran does not outlive it
        ros::WallDuration(0.1).sleep();      // roscpp writes the last answer from a thread of its own
        ros::shutdown();
    });
    delete ros;
}

const uint8_t *cn_ros_message_bytes(const cn_ros_message *message, size_t *size)
{
    *size = message->mesh->bytes.size();
    return message->mesh->bytes.data();
}
void cn_ros_message_free(cn_ros_message *message)
{
    delete message;
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
    for (; *except; except++) {
        const std::string name = *except;
        for (auto i = all.begin(); i != all.end();)
            i = name.back() == '.' ? (i->first.compare(0, name.size(), name) ? std::next(i) : all.erase(i))
                                   : (i->first == name ? all.erase(i) : std::next(i));
    }
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

const cn_ros_version *cn_ros_versions(void)
{
#define TEXT_OF(a) #a
#define TEXT(a)    TEXT_OF(a)
    static const cn_ros_version versions[] = {
        {"roscpp", TEXT(ROS_VERSION_MAJOR) "." TEXT(ROS_VERSION_MINOR) "." TEXT(ROS_VERSION_PATCH)},
        {"ompl", CATNAV_OMPL_VERSION},
        {"octomap", CATNAV_OCTOMAP_VERSION},
        {"suitesparse", TEXT(SUITESPARSE_MAIN_VERSION) "." TEXT(SUITESPARSE_SUB_VERSION) "." TEXT(
                            SUITESPARSE_SUBSUB_VERSION)},
        {"compiler", __VERSION__},
        {nullptr, nullptr}};
    return versions;
}
