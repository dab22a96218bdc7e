// oracle.cpp - a second opinion on contact that shares no code with catnav: reads the frames of a run and
// judges each by CGAL's exact predicates. Usage and exit status: see `usage` below, or run it without words.
//
// Crossing: two triangles that have a point in common (a touch counts: strict keeps a gap), between bodies,
// body and wall, and of a body with itself unless they share a corner. Outside: a node that is in no vessel,
// or in a closed obstacle, or of a body wholly inside another; by the parity of the crossings of a segment
// with the surface, each loop of an open vessel closed by a fan about its centroid. Free besides are the
// cylinder on each fan along its normal, as wide as the loop, and the sheath behind a catheter's entry; these
// two are judged in double precision. What is in the sheath is tested against nothing.
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/box_intersection_d.h>

#include <algorithm>
#include <array>
#include <climits>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace
{

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;
using Vector = Kernel::Vector_3;
using Triangle = Kernel::Triangle_3;
using Segment = Kernel::Segment_3;
using Corners = std::array<int, 3>;

const char usage[] =
    "oracle FRAMES [--vessels N] [--deforms I=NAME] [--sheath NAME,ex,ey,ez,dx,dy,dz,radius]\n"
    "oracle --self-test\n"
    "  FRAMES: folder that `catnav run --frames` wrote; --vessels: wall_0 to wall_N-1 are vessels, the rest "
    "obstacles\n"
    "  (default: all); --deforms: wall_I gives way, its pieces are NAME_STEP.vtu; --sheath: of the catheter "
    "NAME\n"
    "  prints `N frames, M crossings, K outside` and the first places; exit 0: none, 2: some, 1: cannot be "
    "read\n";

// --- surfaces ---

struct Surface {
    std::vector<Point> x;
    std::vector<Corners> tri;

    Triangle triangle(const Corners &c) const { return {x[c[0]], x[c[1]], x[c[2]]}; }
};

// A closed triangle soup to ask whether a point is inside it.
class Inside
{
    using Iterator = std::vector<Triangle>::const_iterator;
    using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, CGAL::AABB_triangle_primitive<Kernel, Iterator>>>;
    std::vector<Triangle> triangles;
    Tree tree;
    Point middle{0, 0, 0};
    double reach = 0;

  public:
    explicit Inside(std::vector<Triangle> soup)
    {
        for (const Triangle &t : soup)
            if (!t.is_degenerate()) triangles.push_back(t); // no general segment meets one
        tree.insert(triangles.begin(), triangles.end());
        tree.build();
        if (triangles.empty()) return;
        const CGAL::Bbox_3 box = tree.bbox();
        middle = {(box.xmin() + box.xmax()) / 2, (box.ymin() + box.ymax()) / 2,
                  (box.zmin() + box.zmax()) / 2};
        reach = 3 * std::hypot(box.x_span(), box.y_span(), box.z_span());
    }

    bool has(const Point &p) const
    {
        if (triangles.empty() || !CGAL::do_overlap(tree.bbox(), p.bbox())) return false;
        for (int k = 1; k <= 64; k++) { // another direction where the segment meets an edge
            const double up = std::cos(1.7 * k), across = std::sin(1.7 * k), turn = 2.4 * k;
            const Point q(middle.x() + reach * across * std::cos(turn),
                          middle.y() + reach * across * std::sin(turn), middle.z() + reach * up);
            std::vector<Iterator> met;
            tree.all_intersected_primitives(Segment(p, q), std::back_inserter(met));
            bool general = true;
            for (const Iterator &t : met)
                for (int i = 0; i < 3; i++)
                    general = general && !CGAL::coplanar(p, q, t->vertex(i), t->vertex(i + 1));
            if (general) return met.size() % 2;
        }
        return false; // on the surface
    }
};

// Directed edges without a partner the other way, chained to loops.
std::vector<std::vector<int>> loops_of(const Surface &s)
{
    std::map<std::pair<int, int>, int> excess;
    std::multimap<int, int> next;
    for (const Corners &c : s.tri)
        for (int i = 0; i < 3; i++) {
            const int a = c[i], b = c[(i + 1) % 3];
            excess[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
        }
    for (const auto &e : excess)
        for (int k = 0; k < std::abs(e.second); k++)
            e.second > 0 ? next.emplace(e.first.first, e.first.second)
                         : next.emplace(e.first.second, e.first.first);
    std::vector<std::vector<int>> loops;
    while (!next.empty()) {
        loops.emplace_back();
        for (auto at = next.begin(); at != next.end(); at = next.find(loops.back().back())) {
            if (loops.back().empty()) loops.back().push_back(at->first);
            loops.back().push_back(at->second);
            next.erase(at);
        }
        loops.back().pop_back(); // closes where it began
    }
    return loops;
}

struct Corridor {
    Point centre;
    Vector normal; // unit, outward
    double radius2;

    bool has(const Point &p) const
    {
        const Vector d = p - centre;
        const double along = d * normal;
        return along >= 0 && d.squared_length() - along * along <= radius2;
    }
};

// The space that a vessel or an obstacle encloses.
struct Space {
    std::unique_ptr<Inside> inside; // null: an open obstacle encloses none
    std::vector<Corridor> corridors;

    Space(const Surface &s, const std::vector<std::vector<int>> &loops, bool vessel)
    {
        std::vector<Triangle> soup;
        if (!vessel && !loops.empty()) return;
        for (const Corners &c : s.tri)
            soup.push_back(s.triangle(c));
        for (const std::vector<int> &loop : loops) {
            const size_t n = loop.size();
            Vector sum(0, 0, 0), area(0, 0, 0);
            double length = 0, level = INFINITY, radius2 = 0;
            for (size_t i = 0; i < n; i++) {
                const Point &a = s.x[loop[i]], &b = s.x[loop[(i + 1) % n]];
                const double l = std::sqrt((b - a).squared_length());
                sum = sum + l / 2 * ((a - CGAL::ORIGIN) + (b - CGAL::ORIGIN)), length += l;
            }
            const Point apex = CGAL::ORIGIN + sum / length;
            for (size_t i = 0; i < n; i++) {
                const Point &a = s.x[loop[i]], &b = s.x[loop[(i + 1) % n]];
                soup.emplace_back(apex, b, a);
                area = area + CGAL::cross_product(b - apex, a - apex);
            }
            area = area / std::sqrt(area.squared_length());
            for (const int v : loop) {
                const Vector d = s.x[v] - apex;
                level = std::fmin(level, d * area);
                radius2 = std::fmax(radius2, d.squared_length() - (d * area) * (d * area));
            }
            corridors.push_back({apex + level * area, area, radius2});
        }
        inside.reset(new Inside(std::move(soup)));
    }

    bool has(const Point &p) const
    {
        for (const Corridor &c : corridors)
            if (c.has(p)) return true;
        return inside && inside->has(p);
    }
};

// --- crossings ---

// The edges of a triangle that is none but in name: together they are all of it.
template <class Other> bool edges_meet(const Triangle &flat, const Other &other)
{
    for (int i = 0; i < 3; i++) {
        const Segment edge(flat.vertex(i), flat.vertex(i + 1));
        if (!edge.is_degenerate() && CGAL::do_intersect(edge, other)) return true;
    }
    return false;
}

bool meet(const Triangle &a, const Triangle &b)
{
    if (!a.is_degenerate() && !b.is_degenerate()) return CGAL::do_intersect(a, b);
    if (!a.is_degenerate()) return edges_meet(b, a);
    if (!b.is_degenerate()) return edges_meet(a, b);
    for (int i = 0; i < 3; i++)
        if (edges_meet(a, Segment(b.vertex(i), b.vertex(i + 1)))) return true;
    return false;
}

using Box = CGAL::Box_intersection_d::Box_with_info_d<double, 3, int>;

CGAL::Bbox_3 box_of(const Surface &s, const std::vector<int> &tri)
{
    CGAL::Bbox_3 box;
    for (const int t : tri)
        box += s.triangle(s.tri[t]).bbox();
    return box;
}

std::vector<Box> boxes_of(const Surface &s, const std::vector<int> &tri, const CGAL::Bbox_3 &within)
{
    std::vector<Box> boxes;
    for (const int t : tri) {
        const CGAL::Bbox_3 box = s.triangle(s.tri[t]).bbox();
        if (CGAL::do_overlap(box, within)) boxes.emplace_back(box, t);
    }
    return boxes;
}

// Calls found(i, j) for each crossing pair of the triangles `of_a` of a and `of_b` of b, which may be the
// same.
void cross(const Surface &a, const std::vector<int> &of_a, const Surface &b, const std::vector<int> &of_b,
           const std::function<void(int, int)> &found)
{
    const bool self = &a == &b;
    const auto test = [&](const Box &p, const Box &q) {
        const Corners &c = a.tri[p.info()], &d = b.tri[q.info()];
        for (int i = 0; self && i < 9; i++)
            if (c[i / 3] == d[i % 3]) return;
        if (meet(a.triangle(c), b.triangle(d))) found(p.info(), q.info());
    };
    std::vector<Box> p = boxes_of(a, of_a, box_of(b, of_b)), q;
    if (self) return CGAL::box_self_intersection_d(p.begin(), p.end(), test);
    q = boxes_of(b, of_b, box_of(a, of_a));
    CGAL::box_intersection_d(p.begin(), p.end(), q.begin(), q.end(), test);
}

// --- files in VTK's XML formats, arrays appended raw ---

std::string text_of(const std::string &file)
{
    std::ifstream in(file, std::ios::binary);
    if (!in) throw std::runtime_error(file + ": cannot be read");
    return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

std::string attribute(const std::string &text, size_t from, const char *name)
{
    const std::string key = std::string(" ") + name + "=\"";
    const size_t at = text.find(key, from) + key.size();
    return text.substr(at, text.find('"', at) - at);
}

template <class T> std::vector<T> array_of(const std::string &text, const char *name, const std::string &file)
{
    const size_t at = text.find(std::string("Name=\"") + name + "\"");
    const std::string mark = "<AppendedData encoding=\"raw\">\n_";
    const size_t data = text.find(mark);
    if (at == std::string::npos || data == std::string::npos || at > data)
        throw std::runtime_error(file + ": has no appended array " + name);
    size_t from = data + mark.size() + std::stoull(attribute(text, at, "offset"));
    uint64_t size;
    if (from + sizeof size > text.size()) throw std::runtime_error(file + ": is cut off");
    std::memcpy(&size, &text[from], sizeof size);
    if ((from += sizeof size) + size > text.size()) throw std::runtime_error(file + ": is cut off");
    std::vector<T> out(size / sizeof(T));
    std::memcpy(out.data(), &text[from], out.size() * sizeof(T));
    return out;
}

std::vector<Point> points_of(const std::string &text, const std::string &file)
{
    const std::vector<double> x = array_of<double>(text, "Points", file);
    std::vector<Point> points;
    for (size_t i = 0; i + 2 < x.size(); i += 3) {
        if (!std::isfinite(x[i] + x[i + 1] + x[i + 2]))
            throw std::runtime_error(file + ": has a point that is not finite");
        points.emplace_back(x[i], x[i + 1], x[i + 2]);
    }
    return points;
}

// Triangles of a piece; of tetrahedra those on the outside, of quadratic ones four for each face.
Surface surface_of(const std::string &file)
{
    const std::string text = text_of(file);
    const std::vector<int32_t> corner = array_of<int32_t>(text, "connectivity", file);
    const std::vector<int32_t> offset = array_of<int32_t>(text, "offsets", file);
    Surface s;
    s.x = points_of(text, file);
    const size_t width = offset.empty() ? 3 : offset[0];
    if (width == 3) {
        for (size_t i = 0; i + 2 < corner.size(); i += 3)
            s.tri.push_back({corner[i], corner[i + 1], corner[i + 2]});
        return s;
    }
    if (width != 4 && width != 10)
        throw std::runtime_error(file + ": has cells that are no triangles or tetrahedra");
    // corners of a face, outward, and the nodes amid its edges 01 12 20
    static const int faces[4][6] = {
        {0, 2, 1, 6, 5, 4}, {0, 1, 3, 4, 8, 7}, {1, 2, 3, 5, 9, 8}, {0, 3, 2, 7, 9, 6}};
    std::map<Corners, std::vector<std::array<int, 6>>> seen; // by sorted corners
    for (size_t e = 0; e + width <= corner.size(); e += width)
        for (const int(&face)[6] : faces) {
            std::array<int, 6> f{};
            for (size_t k = 0; k < (width == 4 ? 3 : 6); k++)
                f[k] = corner[e + face[k]];
            Corners key = {f[0], f[1], f[2]};
            std::sort(key.begin(), key.end());
            seen[key].push_back(f);
        }
    for (const auto &entry : seen) {
        const std::array<int, 6> &f = entry.second[0];
        if (entry.second.size() > 1) continue;
        if (width == 4)
            s.tri.push_back({f[0], f[1], f[2]});
        else
            s.tri.insert(s.tri.end(),
                         {{f[0], f[3], f[5]}, {f[3], f[1], f[4]}, {f[5], f[4], f[2]}, {f[3], f[4], f[5]}});
    }
    return s;
}

// --- a run ---

struct Sheath {
    Point entry;
    Vector direction; // unit
    double radius;

    bool has(const Point &p) const
    {
        const Vector d = p - entry;
        const double along = d * direction, across2 = d.squared_length() - along * along;
        return along <= 1e-9 * radius && across2 <= radius * radius * (1 + 1e-6);
    }
};

struct Part {
    std::string name;
    bool wall = false, vessel = false, deforms = true, read = false;
    Surface surface;
    std::vector<std::vector<int>> loops;
    std::shared_ptr<Sheath> sheath;
    std::vector<int> tested; // triangles wholly out of the sheath
    size_t free = 0;         // leading points out of it
    std::shared_ptr<Space> space;

    // Takes a surface, or new places of the points.
    void take(Surface now)
    {
        surface = std::move(now);
        loops = loops_of(surface);
        moved();
    }
    void moved()
    {
        free = surface.x.size();
        while (sheath && free > 0 && sheath->has(surface.x[free - 1]))
            free--;
        tested.clear();
        for (size_t t = 0; t < surface.tri.size(); t++) {
            const Corners &c = surface.tri[t];
            if (static_cast<size_t>(std::max({c[0], c[1], c[2]})) < free)
                tested.push_back(static_cast<int>(t));
        }
        space.reset();
    }
    bool encloses(const Point &p)
    {
        if (free < surface.x.size() || surface.tri.empty()) return false; // its end is in the sheath
        if (!space) space.reset(new Space(surface, loops, vessel));
        return space->has(p);
    }
};

class Judge
{
    long frames = 0, crossings = 0, outside = 0;
    std::string places;
    int told = 0;

    void tell(int step, const std::string &what, const Point &p)
    {
        std::ostringstream line;
        line.precision(9);
        line << "  step " << step << ": " << what << " at " << p << "\n";
        if (told++ < 10) places += line.str();
    }

  public:
    void frame(int step, std::vector<Part> &parts)
    {
        bool vessels = false;
        frames++;
        for (size_t i = 0; i < parts.size(); i++)
            for (size_t j = i; j < parts.size(); j++) {
                const Part &a = parts[i], &b = parts[j];
                if (a.wall && b.wall && (i == j || (!a.deforms && !b.deforms) || (a.vessel && b.vessel)))
                    continue;
                cross(a.surface, a.tested, b.surface, b.tested, [&](int p, int q) {
                    crossings++;
                    tell(step,
                         a.name + " triangle " + std::to_string(p) + " crosses " + b.name + " triangle " +
                             std::to_string(q),
                         a.surface.x[a.surface.tri[p][0]]);
                });
            }
        for (const Part &b : parts)
            vessels = vessels || b.vessel;
        for (const Part &a : parts)
            for (size_t i = 0; i < a.free && !a.wall; i++) {
                const Point &p = a.surface.x[i];
                bool in = !vessels;
                std::string where;
                for (Part &b : parts)
                    if (b.vessel)
                        in = in || b.encloses(p);
                    else if (&b != &a && (b.wall || i == 0) && b.encloses(p))
                        where = " is inside " + b.name;
                if (!in) where = " is outside";
                if (where.empty()) continue;
                outside++;
                tell(step, a.name + " node " + std::to_string(i) + where, p);
            }
    }

    int verdict() const
    {
        std::printf("%ld frames, %ld crossings, %ld outside\n%s", frames, crossings, outside, places.c_str());
        return crossings + outside ? 2 : 0;
    }
    long ncrossing() const { return crossings; }
    long noutside() const { return outside; }
};

int judge_run(int argc, char **argv)
{
    const std::string folder = argv[1];
    std::map<int, std::string> deforming;
    std::map<std::string, Sheath> sheaths;
    std::vector<Part> parts;
    int nvessel = INT_MAX;
    for (int i = 2; i + 1 < argc; i += 2) {
        const std::string word = argv[i], value = argv[i + 1];
        if (word == "--vessels") {
            nvessel = std::stoi(value);
        } else if (word == "--deforms") {
            deforming[std::stoi(value)] = value.substr(value.find('=') + 1);
        } else if (word == "--sheath") {
            std::istringstream in(value.substr(value.find(',')));
            double v[7];
            char comma;
            for (double &number : v)
                if (!(in >> comma >> number))
                    throw std::runtime_error("--sheath NAME,ex,ey,ez,dx,dy,dz,radius");
            const Vector d(v[3], v[4], v[5]);
            sheaths[value.substr(0, value.find(','))] = {Point(v[0], v[1], v[2]),
                                                         d / std::sqrt(d.squared_length()), v[6]};
        } else
            throw std::runtime_error("unknown word " + word);
    }
    for (int i = 0;; i++) {
        const std::string file = folder + "/wall_" + std::to_string(i) + ".vtp";
        if (!deforming.count(i) && !std::ifstream(file)) break;
        Part part;
        part.name = deforming.count(i) ? deforming[i] : "wall_" + std::to_string(i);
        part.wall = true, part.vessel = i < nvessel, part.deforms = deforming.count(i);
        if (!part.deforms) part.take(surface_of(file));
        parts.push_back(std::move(part));
    }

    if (nvessel < INT_MAX && parts.size() < static_cast<size_t>(nvessel))
        throw std::runtime_error(folder + ": " + std::to_string(parts.size()) + " walls are there, " +
                                 std::to_string(nvessel) + " vessels were told");

    Judge judge;
    std::istringstream index(text_of(folder + "/frames.pvd"));
    std::string line;
    int now = -1;
    while (std::getline(index, line)) {
        if (line.find(".vtu\"") == std::string::npos) continue; // a skin is only looked at
        const std::string piece = attribute(line, 0, "file"), file = folder + "/" + piece;
        const std::string name = piece.substr(0, piece.rfind('_'));
        const int step = std::stoi(piece.substr(name.size() + 1));
        if (now >= 0 && step != now) judge.frame(now, parts);
        now = step;
        Part *part = nullptr;
        for (Part &p : parts)
            if (p.name == name && p.deforms) part = &p;
        if (!part) {
            parts.emplace_back(), part = &parts.back();
            part->name = name;
            if (sheaths.count(name)) part->sheath.reset(new Sheath(sheaths.at(name)));
        }
        if (!part->read)
            part->take(surface_of(file)), part->read = true;
        else
            part->surface.x = points_of(text_of(file), file), part->moved();
    }
    if (now >= 0) judge.frame(now, parts);
    for (const auto &sheath : sheaths)
        if (std::none_of(parts.begin(), parts.end(), [&](const Part &p) { return p.name == sheath.first; }))
            throw std::runtime_error("no piece of " + sheath.first + ", which has a sheath");
    for (const Part &p : parts)
        if (p.wall && p.deforms && !p.read)
            throw std::runtime_error("no piece of " + p.name + ", which gives way");
    return judge.verdict();
}

// --- what it must find and what it must not ---

int failures = 0;

void expect(bool holds, const char *what)
{
    std::printf("%s: %s\n", holds ? "ok" : "FAILED", what);
    failures += !holds;
}

Part body(const char *name, std::vector<Point> x, std::vector<Corners> tri)
{
    Part part;
    part.name = name;
    part.take({std::move(x), std::move(tri)});
    return part;
}

// A box from a to b, outward; without its top when open.
Part box(const char *name, double a, double b, bool open)
{
    std::vector<Point> x;
    for (int i = 0; i < 8; i++)
        x.emplace_back(i & 1 ? b : a, i & 2 ? b : a, i & 4 ? b : a);
    std::vector<Corners> tri = {{0, 3, 1}, {0, 2, 3}, {0, 1, 5}, {0, 5, 4}, {1, 3, 7}, {1, 7, 5},
                                {3, 2, 6}, {3, 6, 7}, {2, 0, 4}, {2, 4, 6}, {4, 5, 7}, {4, 7, 6}};
    tri.resize(open ? 10 : 12);
    return body(name, x, tri);
}

// Crossings and places outside of what is given.
std::pair<long, long> judged(std::vector<Part> parts)
{
    Judge judge;
    judge.frame(0, parts);
    return {judge.ncrossing(), judge.noutside()};
}

Part as_wall(Part part, bool vessel)
{
    part.wall = true, part.vessel = vessel, part.deforms = false;
    return part;
}

int self_test()
{
    using Count = std::pair<long, long>;
    const auto flat = [](const char *name, double z) {
        return body(name, {{0, 0, z}, {1, 0, z}, {0, 1, z}}, {{0, 1, 2}});
    };
    const auto spike = [](const char *name, double tip) {
        return body(name, {{0.25, 0.25, tip}, {0.25, 0.5, 2}, {0.5, 0.25, 2}}, {{0, 1, 2}});
    };
    for (const double base : {0.0, 0.3, 1.0 / 3}) {
        const double above = std::nextafter(base, 1), below = std::nextafter(base, -1);
        expect(judged({flat("a", base), spike("b", below)}) == Count(1, 0),
               "a tip one rounding deep crosses");
        expect(judged({flat("a", base), spike("b", base)}) == Count(1, 0), "a tip on a triangle touches it");
        expect(judged({flat("a", base), spike("b", above)}) == Count(0, 0),
               "a tip one rounding above is free");
        expect(judged({flat("a", base), flat("b", above)}) == Count(0, 0),
               "sheets one rounding apart are free");
        expect(judged({flat("a", base), flat("b", base)}) == Count(1, 0), "sheets in one plane meet");
    }
    expect(judged({body("fold", {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {.2, .2, 1}, {.3, .2, -1}},
                        {{0, 1, 2}, {0, 3, 4}})}) == Count(0, 0),
           "triangles of a body that share a corner are left out");
    expect(judged({body("fold", {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {.2, .2, 1}, {.3, .2, -1}, {.2, .3, 1}},
                        {{0, 1, 2}, {3, 4, 5}})}) == Count(1, 0),
           "others of a body are not");
    expect(judged({body("line", {{0, 0, -1}, {0, 0, 1}, {0, 0, 0}}, {{0, 1, 2}}), flat("a", 0)}) ==
               Count(1, 0),
           "a triangle without area still crosses");

    const auto dust = [](double x, double y, double z) { return body("dust", {{x, y, z}}, {}); };
    for (const bool open : {false, true}) {
        const Part vessel = as_wall(box("vessel", 0, 1, open), true);
        expect(judged({vessel, dust(.5, .5, .5)}) == Count(0, 0), "in the middle of a vessel is inside");
        expect(judged({vessel, dust(.25, .25, std::nextafter(0., 1))}) == Count(0, 0),
               "right above its floor too");
        expect(judged({vessel, dust(.25, .25, -1e-300)}) == Count(0, 1), "right below its floor is outside");
        expect(judged({vessel, dust(std::nextafter(1., 2), .5, .5)}) == Count(0, 1),
               "right beside its wall too");
        expect(judged({vessel, dust(.5, .5, 1.5)}) == Count(0, open ? 0 : 1),
               "beyond an open end is its corridor");
        expect(judged({vessel, dust(.5, 1.5, 1.5)}) == Count(0, 1), "beside the corridor is outside");
    }
    expect(judged({as_wall(box("rock", 0, 1, false), false), dust(.5, .5, .5)}) == Count(0, 1),
           "in a rock is outside");
    expect(judged({as_wall(box("bowl", 0, 1, true), false), dust(.5, .5, .5)}) == Count(0, 0),
           "in a bowl is free");
    expect(judged({box("big", 0, 1, false), box("small", .4, .6, false)}) == Count(0, 1),
           "a body in a body is seen");
    Part wire = body("wire", {{.5, .5, .5}, {.5, .5, -.5}, {.6, .5, -.5}}, {{0, 1, 2}});
    expect(judged({as_wall(box("vessel", 0, 1, false), true), wire}).first > 0,
           "a wire through the floor crosses");
    wire.sheath.reset(new Sheath{Point(.5, .5, 0), Vector(0, 0, 1), 0.1});
    wire.moved();
    expect(judged({as_wall(box("vessel", 0, 1, false), true), wire}) == Count(0, 0),
           "unless its end is in the sheath");
    std::printf("%d failed\n", failures);
    return failures > 0;
}

} // namespace

int main(int argc, char **argv)
{
    try {
        if (argc == 2 && !std::strcmp(argv[1], "--self-test")) return self_test();
        if (argc >= 2 && argc % 2 == 0) return judge_run(argc, argv);
    } catch (const std::exception &e) {
        std::fprintf(stderr, "oracle: %s\n", e.what());
        return 1;
    }
    std::fputs(usage, stderr);
    return 1;
}
