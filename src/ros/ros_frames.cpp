// ros_frames.cpp - transforms by tf2.
#include <Eigen/Geometry>
#include "ros_parts.h"

cn_status cn_ros_transform(cn_ros *ros, const char *from, const char *to, uint64_t stamp, double wait,
                           cn_ros_motion *motion, cn_error *error)
{
    try {
        ros::Time time;
        time.fromNSec(stamp);
        const auto t = ros->frames->buffer.lookupTransform(to, from, time, ros::Duration(wait)).transform;
        const Eigen::Quaterniond q(t.rotation.w, t.rotation.x, t.rotation.y, t.rotation.z);
        const Eigen::Matrix3d r = q.normalized().toRotationMatrix();
        for (int i = 0; i < 9; i++)
            motion->rotation[i] = r(i / 3, i % 3);
        motion->translation[0] = t.translation.x;
        motion->translation[1] = t.translation.y;
        motion->translation[2] = t.translation.z;
        for (const double v : motion->translation)
            if (!std::isfinite(v) || !r.allFinite())
                return cn_fail(error, CN_ERR_NOT_FINITE, "", 0,
                               "the transform from frame '%.60s' to '%.60s' is not finite", from, to);
        return CN_OK;
    } catch (const std::exception &e) {
        return cn_fail(
            error, CN_ERR_ARG, "", 0,
            "no transform from frame '%.60s' to '%.60s': %.200s; send it in '%.60s' or publish the "
            "transform on /tf",
            from, to, e.what(), to);
    }
}
