// flood.cpp - sends meshes, goals and cancels to a node as fast as it is asked to, as if from another
// machine.
//
//     catnav_flood NODE SECONDS RATE      RATE: of all three together [1/s]; 0 SECONDS: once each
//
// Prints how many of each have left. No mesh is like the one before it, all are tubes; goals and cancels name
// each other.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <thread>
#include <catnav/PlanCatheterActionGoal.h>
#include <catnav/SurfaceMesh.h>
#include <ros/ros.h>

using Clock = std::chrono::steady_clock;

// A straight open tube along z, 80 mm long, its normals outwards.
static catnav::SurfaceMesh tube(double radius)
{
    const uint32_t rings = 11, sides = 16;
    catnav::SurfaceMesh mesh;
    mesh.header.frame_id = "map";
    for (uint32_t i = 0; i < rings * sides; i++) {
        geometry_msgs::Point p;
        p.x = radius * std::cos(2 * M_PI * (i % sides) / sides);
        p.y = radius * std::sin(2 * M_PI * (i % sides) / sides);
        p.z = 0.08 * (i / sides) / (rings - 1);
        mesh.surface.vertices.push_back(p);
    }
    for (uint32_t i = 0; i < (rings - 1) * sides; i++) {
        const uint32_t a = i, b = i / sides * sides + (i + 1) % sides;
        shape_msgs::MeshTriangle t;
        t.vertex_indices = {a, b, b + sides};
        mesh.surface.triangles.push_back(t);
        t.vertex_indices = {a, b + sides, a + sides};
        mesh.surface.triangles.push_back(t);
    }
    return mesh;
}

// Calls send(i) `rate` times a second in strokes of a millisecond until `end`; how often.
template <class Send> static void pour(double rate, Clock::time_point end, long &sent, Send send)
{
    const auto begin = Clock::now();
    for (auto now = begin; sent == 0 || now < end; now = Clock::now()) {
        const double due = rate * std::chrono::duration<double>(now - begin).count();
        for (; sent == 0 || double(sent) < due; sent++)
            send(sent);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
}

int main(int argc, char **argv)
{
    ros::init(argc, argv, "flood", ros::init_options::AnonymousName);
    if (argc != 4) return 2;
    ros::NodeHandle handle(argv[1]);
    const double seconds = atof(argv[2]), rate = atof(argv[3]) / 3;
    auto meshes = handle.advertise<catnav::SurfaceMesh>("artery_mesh", 100);
    auto goals = handle.advertise<catnav::PlanCatheterActionGoal>("plan_action/goal", 100);
    auto cancels = handle.advertise<actionlib_msgs::GoalID>("plan_action/cancel", 100);
    for (const auto *p : {&meshes, &goals, &cancels})
        while (p->getNumSubscribers() == 0 && ros::ok())
            ros::WallDuration(0.01).sleep();

    catnav::SurfaceMesh mesh[7];
    for (int i = 0; i < 7; i++)
        mesh[i] = tube(0.004 + 1e-5 * i);
    const auto name = [](long i) { return "flood " + std::to_string(i); };
    catnav::PlanCatheterActionGoal goal;
    goal.goal.waypoints.resize(2);
    goal.goal.waypoints[0].z = 0.01;
    goal.goal.waypoints[1].z = 0.06;
    long sent[3] = {0, 0, 0};
    const auto end =
        Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
    std::thread pourers[] = {
        std::thread([&] { pour(rate, end, sent[0], [&](long i) { meshes.publish(mesh[i % 7]); }); }),
        std::thread([&] {
            pour(rate, end, sent[1], [&](long i) {
                goal.goal_id.id = name(i);
                goal.goal_id.stamp = ros::Time::now();
                goals.publish(goal);
            });
        }),
        std::thread([&] {
            pour(rate, end, sent[2], [&](long i) {
                actionlib_msgs::GoalID id;
                id.id = name(i);
                cancels.publish(id);
            });
        })};
    for (auto &pourer : pourers)
        pourer.join();
    ros::WallDuration(0.2).sleep(); // what has been published is written by a thread of roscpp's
    printf("%ld %ld %ld\n", sent[0], sent[1], sent[2]);
    return 0;
}
