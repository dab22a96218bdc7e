// octree.cpp - the map's free cubes: a list in the order of their places, which samples and membership are
// taken from, and as leaves of an OctoMap tree, made when first asked for. Each leaf is created at its place
// on the way down from the root, whose last branch is kept: no updateNode, no pruning, no value but its own.
#include "catnav/octree.h"

#include <octomap/octomap.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <memory>
#include <mutex>
#include <new>
#include <vector>

namespace
{
constexpr int depth_most = 16, middle = 1 << (depth_most - 1); // OctoMap's key of coordinate 0

class Tree : public octomap::OcTree
{
  public:
    explicit Tree(double cell) : OcTree(cell), branch_() {}

    // Makes the cube of 2^level cells at `corner` a leaf, unless it is one already.
    void add(const int corner[3], int level, float value)
    {
        octomap::OcTreeKey key;
        for (int k = 0; k < 3; k++)
            key[k] = octomap::key_type(corner[k] + middle);
        if (!root) {
            root = new octomap::OcTreeNode();
            tree_size++;
            branch_[0] = root;
            key_ = key;
        }
        int depth = 0; // as far as the last branch goes the same way
        const int same = (key[0] ^ key_[0]) | (key[1] ^ key_[1]) | (key[2] ^ key_[2]);
        while (depth < depth_most - level && branch_[depth + 1] && !(same >> (depth_most - 1 - depth)))
            depth++;
        for (; depth < depth_most - level; depth++) {
            const unsigned child = octomap::computeChildIdx(key, depth_most - 1 - depth);
            octomap::OcTreeNode *node = branch_[depth];
            branch_[depth + 1] =
                nodeChildExists(node, child) ? getNodeChild(node, child) : createNodeChild(node, child);
        }
        branch_[depth]->setLogOdds(value);
        std::fill(branch_.begin() + depth + 1, branch_.end(), nullptr);
        key_ = key;
    }

    bool has(const int cell[3]) const
    {
        octomap::OcTreeKey key;
        for (int k = 0; k < 3; k++) {
            if (cell[k] < -middle || cell[k] >= middle) return false;
            key[k] = octomap::key_type(cell[k] + middle);
        }
        return root && search(key) != nullptr;
    }

    // OctoMap's own writer prints to the console.
    void write(std::ostream &s) const
    {
        s.precision(17);
        s << "# Octomap OcTree binary file\nid OcTree\nsize " << size() << "\nres " << resolution
          << "\ndata\n";
        if (root) writeBinaryNode(s, root);
    }

  private:
    std::array<octomap::OcTreeNode *, depth_most + 1> branch_;
    octomap::OcTreeKey key_;
};

struct Cube {
    unsigned short corner[3];
    unsigned short level;
};
} // namespace

struct cn_octree {
    const cn_map *map;
    double cell, origin[3];
    std::vector<Cube> cube;         // free cubes in visiting order: by the bits of z, y, x in turn
    std::vector<double> cells_upto; // cells in cubes 0..i: to draw one by volume
    mutable std::once_flag made;    // the trees:
    mutable std::unique_ptr<Tree> lumen, ridge;
};

namespace
{
void index_of(const cn_octree *octree, const double p[3], int cell[3])
{
    for (int k = 0; k < 3; k++) {
        const double i = std::floor((p[k] - octree->origin[k]) / octree->cell);
        cell[k] = i >= -middle && i < middle ? int(i) : -middle - 1; // NaN too: nowhere
    }
}

// Does place a come before b in the order of the cubes? The highest bit in which they differ decides.
bool before(const int a[3], const int b[3])
{
    int axis = 2, most = a[2] ^ b[2];
    for (int k = 1; k >= 0; k--) {
        const int x = a[k] ^ b[k];
        if (most < x && most < (most ^ x)) most = x, axis = k;
    }
    return a[axis] < b[axis];
}

struct Build {
    cn_octree *octree;
    bool failed; // exceptions stop here: the visitor is called from C
};

extern "C" void visit_cube(void *user, const int corner[3], int level)
{
    Build *build = static_cast<Build *>(user);
    if (build->failed) return;
    try {
        cn_octree *o = build->octree;
        o->cube.push_back({{(unsigned short)corner[0], (unsigned short)corner[1], (unsigned short)corner[2]},
                           (unsigned short)level});
        o->cells_upto.push_back((o->cells_upto.empty() ? 0 : o->cells_upto.back()) +
                                std::ldexp(1.0, 3 * level));
    } catch (...) {
        build->failed = true;
    }
}

void makeTrees(const cn_octree *octree)
{
    std::unique_ptr<Tree> lumen(new Tree(octree->cell)), ridge(new Tree(octree->cell));
    for (const Cube &cube : octree->cube) {
        const int corner[3] = {cube.corner[0], cube.corner[1], cube.corner[2]};
        lumen->add(corner, cube.level, lumen->getClampingThresMinLog());
    }
    lumen->updateInnerOccupancy();

    const double *x, *clearance;
    const int n = cn_map_ridge(octree->map, &x, &clearance);
    for (int i = 0; i < n; i++) {
        int cell[3];
        index_of(octree, x + 3 * i, cell);
        if (cell[0] >= 0 && cell[1] >= 0 && cell[2] >= 0)
            ridge->add(cell, 0, ridge->getClampingThresMaxLog());
    }
    ridge->updateInnerOccupancy();
    octree->lumen = std::move(lumen), octree->ridge = std::move(ridge);
}

// Makes the trees unless they are there; false: out of memory, and the next call tries again.
bool haveTrees(const cn_octree *octree)
{
    try {
        std::call_once(octree->made, makeTrees, octree);
        return true;
    } catch (const std::exception &) {
        return false;
    }
}
} // namespace

cn_status cn_octree_new(cn_octree **out, const cn_map *map, cn_error *error)
{
    *out = nullptr;
    if (!map) return cn_fail(error, CN_ERR_ARG, nullptr, 0, "an octree needs a map");
    try {
        std::unique_ptr<cn_octree> octree(new cn_octree());
        int size[3];
        octree->map = map;
        octree->cell = cn_map_cell(map);
        cn_map_frame(map, octree->origin, size);
        if (*std::max_element(size, size + 3) > middle)
            return cn_fail(error, CN_ERR_ARG, nullptr, 0,
                           "the map has more than %d cells a side: set planner.resolution to a larger cell",
                           middle);
        Build state = {octree.get(), false};
        cn_map_visit_cubes(map, visit_cube, &state);
        if (state.failed) throw std::bad_alloc();
        *out = octree.release();
        return CN_OK;
    } catch (const std::bad_alloc &) {
        return cn_fail(error, CN_ERR_MEMORY, nullptr, 0, "out of memory for the octree of the free space");
    } catch (const std::exception &e) {
        return cn_fail(error, CN_ERR_ARG, nullptr, 0, "the octree of the free space: %s", e.what());
    }
}

void cn_octree_free(cn_octree *octree)
{
    delete octree;
}

cn_status cn_octree_attach(cn_world *world, cn_error *error)
{
    if (world->octree) return CN_OK;
    const cn_status status = cn_octree_new(&world->octree, world->map, error);
    if (status == CN_OK) world->octree_free = cn_octree_free;
    return status;
}

size_t cn_octree_leaves(const cn_octree *octree)
{
    return octree->cube.size();
}
size_t cn_octree_ridge_leaves(const cn_octree *octree)
{
    return haveTrees(octree) ? octree->ridge->getNumLeafNodes() : 0;
}

size_t cn_octree_memory(const cn_octree *octree)
{
    return (haveTrees(octree) ? octree->lumen->memoryUsage() + octree->ridge->memoryUsage() : 0) +
           octree->cube.capacity() * sizeof(Cube) + octree->cells_upto.capacity() * sizeof(double);
}

double cn_octree_volume(const cn_octree *octree)
{
    return octree->cells_upto.empty()
               ? 0
               : octree->cells_upto.back() * octree->cell * octree->cell * octree->cell;
}

bool cn_octree_free_at(const cn_octree *octree, const double p[3])
{
    int cell[3];
    index_of(octree, p, cell);
    if (cell[0] < 0 || cell[1] < 0 || cell[2] < 0) return false;
    size_t low = 0, high = octree->cube.size(); // the last cube that does not come after the cell
    while (low < high) {
        const size_t half = low + (high - low) / 2;
        const Cube &cube = octree->cube[half];
        const int corner[3] = {cube.corner[0], cube.corner[1], cube.corner[2]};
        if (before(cell, corner))
            high = half;
        else
            low = half + 1;
    }
    if (low == 0) return false;
    const Cube &cube = octree->cube[low - 1];
    return cell[0] >> cube.level == cube.corner[0] >> cube.level &&
           cell[1] >> cube.level == cube.corner[1] >> cube.level &&
           cell[2] >> cube.level == cube.corner[2] >> cube.level;
}

bool cn_octree_ridge_at(const cn_octree *octree, const double p[3])
{
    int cell[3];
    index_of(octree, p, cell);
    return haveTrees(octree) && octree->ridge->has(cell);
}

void cn_octree_sample(const cn_octree *octree, const double u[4], double p[3])
{
    const std::vector<double> &upto = octree->cells_upto;
    if (upto.empty()) {
        std::copy(octree->origin, octree->origin + 3, p);
        return;
    }
    const size_t i = size_t(std::upper_bound(upto.begin(), upto.end(), u[3] * upto.back()) - upto.begin());
    const Cube &cube = octree->cube[std::min(i, upto.size() - 1)];
    for (int k = 0; k < 3; k++)
        p[k] = octree->origin[k] + (cube.corner[k] + u[k] * (1 << cube.level)) * octree->cell;
}

cn_status cn_octree_write(const cn_octree *octree, const char *path, cn_error *error)
{
    try {
        if (!haveTrees(octree)) throw std::bad_alloc();
        Tree both(*octree->lumen);
        const float occupied = both.getClampingThresMaxLog();
        for (auto it = octree->ridge->begin_leafs(); it != octree->ridge->end_leafs(); ++it)
            both.setNodeValue(it.getKey(), occupied, true);
        both.updateInnerOccupancy();
        std::ofstream file(path, std::ios::binary);
        both.write(file);
        file.close();
        if (file) return CN_OK;
        return cn_fail(error, CN_ERR_FILE, path, 0, "the octree cannot be written");
    } catch (const std::bad_alloc &) {
        return cn_fail(error, CN_ERR_MEMORY, path, 0, "out of memory while the octree was written");
    } catch (const std::exception &e) {
        return cn_fail(error, CN_ERR_FILE, path, 0, "the octree cannot be written: %s", e.what());
    }
}
