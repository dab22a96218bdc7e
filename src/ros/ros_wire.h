// ros_wire.h - how messages are taken off the wire: a mesh as bytes, lists only as long as the message
// reaches.
#pragma once

#include <vector>
#include <catnav/Limit.h>
#include <catnav/SurfaceMesh.h>
#include <dynamic_reconfigure/Config.h>
#include <geometry_msgs/Point.h>
#include <ros/message_traits.h>
#include <ros/serialization.h>

namespace catnav
{
// A SurfaceMesh that nobody has looked into: node_wire.c does, and a mesh that is dropped costs no more.
struct WireMesh {
    using ConstPtr = boost::shared_ptr<const WireMesh>;
    std::vector<uint8_t> bytes;
};

// roscpp makes a list as long as its count says and then finds that the message has ended: a message of a few
// bytes would take gigabytes. Here the count is compared with the bytes that are left, `least` an entry.
template <class T, uint32_t least> struct Bounded {
    template <class Stream> static void read(Stream &stream, std::vector<T> &list)
    {
        uint32_t count;
        stream.next(count);
        if (count > stream.getLength() / least)
            throw ros::serialization::StreamOverrunException("Buffer Overrun");
        list.resize(count);
        for (T &entry : list)
            stream.next(entry);
    }
    template <class Stream> static void write(Stream &stream, const std::vector<T> &list)
    {
        stream.next(uint32_t(list.size()));
        for (const T &entry : list)
            stream.next(entry);
    }
    static uint32_t serializedLength(const std::vector<T> &list)
    {
        uint32_t size = 4;
        for (const T &entry : list)
            size += ros::serialization::serializationLength(entry);
        return size;
    }
};
} // namespace catnav

namespace ros
{
namespace message_traits
{
template <> struct MD5Sum<catnav::WireMesh> {
    static const char *value() { return MD5Sum<catnav::SurfaceMesh>::value(); }
    static const char *value(const catnav::WireMesh &) { return value(); }
};
template <> struct DataType<catnav::WireMesh> {
    static const char *value() { return DataType<catnav::SurfaceMesh>::value(); }
    static const char *value(const catnav::WireMesh &) { return value(); }
};
template <> struct Definition<catnav::WireMesh> {
    static const char *value() { return Definition<catnav::SurfaceMesh>::value(); }
    static const char *value(const catnav::WireMesh &) { return value(); }
};
} // namespace message_traits

namespace serialization
{
template <> struct Serializer<catnav::WireMesh> {
    template <class Stream> static void read(Stream &stream, catnav::WireMesh &mesh)
    {
        const uint32_t size = stream.getLength();
        const uint8_t *const begin = stream.advance(size);
        mesh.bytes.assign(begin, begin + size);
    }
};

template <class T, uint32_t least> using Bounded = catnav::Bounded<T, least>;
template <>
struct VectorSerializer<geometry_msgs::Point, std::allocator<geometry_msgs::Point>, void>
    : Bounded<geometry_msgs::Point, 24> {
};
template <>
struct VectorSerializer<catnav::Limit, std::allocator<catnav::Limit>, void> : Bounded<catnav::Limit, 20> {
};
#define BOUNDED(T, least)                                                                                    \
    template <>                                                                                              \
    struct VectorSerializer<dynamic_reconfigure::T, std::allocator<dynamic_reconfigure::T>, void>            \
        : Bounded<dynamic_reconfigure::T, least> {                                                           \
    }
BOUNDED(BoolParameter, 5);
BOUNDED(IntParameter, 8);
BOUNDED(StrParameter, 8);
BOUNDED(DoubleParameter, 12);
BOUNDED(GroupState, 13);
#undef BOUNDED
} // namespace serialization
} // namespace ros
