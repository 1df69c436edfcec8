// tinybvh behind four C functions: build, closest hits, occlusion, release.

#define TINYBVH_IMPLEMENTATION
#include "tiny_bvh.h"

#include <malloc.h>
#include <memory>

using namespace tinybvh;

namespace {

constexpr int LANES = 16;

// lightpath's `Rays` and `Hits` (src/ray.rs), which are Embree's RTCRay16 and RTCHit16.
struct alignas(64) Rays {
    float org[3][LANES], tnear[LANES], dir[3][LANES], time[LANES], tfar[LANES];
    uint32_t mask[LANES], leaving[LANES], flags[LANES];
};
struct alignas(64) Hits {
    float ng[3][LANES], u[LANES], v[LANES];
    uint32_t prim[LANES], geom[LANES], instance[LANES], instance_prim[LANES];
};
constexpr uint32_t NONE = ~0u;

// Memory of a tree, for the Rust side.
struct Cost {
    uint64_t held;  // bytes that the heap grew by, the vertices handed over included
    uint64_t read;  // of these, the bytes that queries read: nodes, triangles, indices, vertices
};

// Bytes in use on the heap, in all arenas and in mappings.
uint64_t heap() {
    const struct mallinfo2 now = mallinfo2();
    return now.uordblks + now.hblkhd;
}

// Converts one lane to a ray of tinybvh, which has a unit direction and no start. The origin is
// moved along the ray to its start, and `offset` further if the ray leaves a surface.
struct Lane {
    double start, length;

    Lane(const Rays& rays, int i, float offset) {
        const double x = rays.dir[0][i], y = rays.dir[1][i], z = rays.dir[2][i];
        length = std::sqrt(x * x + y * y + z * z);
        start = rays.tnear[i] + (rays.leaving[i] == NONE ? 0.0 : offset / length);
    }
    template <typename T> T origin(const Rays& rays, int axis, int i) const {
        return T(rays.org[axis][i] + start * rays.dir[axis][i]);
    }
    double end(const Rays& rays, int i) const { return (rays.tfar[i] - start) * length; }
    // In units of the original direction.
    float t(double along) const { return float(along / length + start); }
};

struct Tree {
    virtual ~Tree() = default;
    // Returns the number of the triangle, or NONE. Sets `t` to the hit.
    virtual uint32_t closest(const Rays& rays, int i, float offset, float& t) const = 0;
    virtual bool occluded(const Rays& rays, int i, float offset) const = 0;
    virtual uint64_t read() const = 0;
};

Ray single(const Rays& rays, int i, const Lane& lane) {
    const bvhvec3 from(lane.origin<float>(rays, 0, i), lane.origin<float>(rays, 1, i),
                       lane.origin<float>(rays, 2, i));
    const bvhvec3 to(rays.dir[0][i], rays.dir[1][i], rays.dir[2][i]);
    const double end = lane.end(rays, i);
    return Ray(from, to, end < BVH_FAR ? float(end) : BVH_FAR);
}

template <typename Layout> struct Float final : Tree {
    Layout tree;

    Float(const float* corners, uint32_t triangles, bool spatial_splits) {
        // The leaves hold copies of the corners, but the builder's own tree still points to the
        // originals.
        const bvhvec4* vertices = reinterpret_cast<const bvhvec4*>(corners);
        if (spatial_splits) tree.BuildHQ(vertices, triangles);
        else tree.Build(vertices, triangles);
    }
    uint32_t closest(const Rays& rays, int i, float offset, float& t) const override {
        const Lane lane(rays, i, offset);
        Ray ray = single(rays, i, lane);
        const float end = ray.hit.t;
        tree.Intersect(ray);
        if (!(ray.hit.t < end)) return NONE;
        t = lane.t(ray.hit.t);
        return ray.hit.prim;
    }
    bool occluded(const Rays& rays, int i, float offset) const override {
        return tree.IsOccluded(single(rays, i, Lane(rays, i, offset)));
    }
    uint64_t read() const override { return uint64_t(tree.usedBlocks) * 64; }
};

struct Double final : Tree {
    std::unique_ptr<bvhdbl3[]> vertices;
    BVH_Double tree;

    Double(const float* corners, uint32_t triangles) : vertices(new bvhdbl3[3 * size_t(triangles)]) {
        for (size_t i = 0; i < 3 * size_t(triangles); i++)
            vertices[i] = bvhdbl3(corners[4 * i], corners[4 * i + 1], corners[4 * i + 2]);
        tree.Build(vertices.get(), triangles);
    }
    static RayEx single(const Rays& rays, int i, const Lane& lane) {
        const bvhdbl3 from(lane.origin<double>(rays, 0, i), lane.origin<double>(rays, 1, i),
                           lane.origin<double>(rays, 2, i));
        const double end = lane.end(rays, i);
        return RayEx(from, bvhdbl3(rays.dir[0][i], rays.dir[1][i], rays.dir[2][i]),
                     end < BVH_DBL_FAR ? end : BVH_DBL_FAR);
    }
    uint32_t closest(const Rays& rays, int i, float offset, float& t) const override {
        const Lane lane(rays, i, offset);
        RayEx ray = single(rays, i, lane);
        const double end = ray.hit.t;
        tree.Intersect(ray);
        if (!(ray.hit.t < end)) return NONE;
        t = lane.t(ray.hit.t);
        return uint32_t(ray.hit.prim);
    }
    bool occluded(const Rays& rays, int i, float offset) const override {
        return tree.IsOccluded(single(rays, i, Lane(rays, i, offset)));
    }
    uint64_t read() const override {
        return tree.usedNodes * sizeof(BVH_Double::BVHNode) + tree.idxCount * sizeof(uint64_t) +
               tree.triCount * 3 * sizeof(bvhdbl3);
    }
};

Tree* make(int layout, const float* corners, uint32_t triangles) {
    switch (layout) {
    case 0: return new Float<BVH8_CPU>(corners, triangles, false);
    case 1: return new Float<BVH8_CPU>(corners, triangles, true);
    case 2: return new Float<BVH4_CPU>(corners, triangles, false);
    default: return new Double(corners, triangles);
    }
}

} // namespace

// `corners`: three per triangle, x, y, z and an unused float each; must outlive the tree.
extern "C" Tree* shim_build(int layout, const float* corners, uint32_t triangles, Cost* cost) {
    const uint64_t before = heap();
    Tree* tree = make(layout, corners, triangles);
    *cost = {heap() - before, tree->read()};
    return tree;
}

extern "C" void shim_release(Tree* tree) { delete tree; }

// Triangles from `quads` on are halves of the quads of geometry 1; the others belong to geometry 0.
extern "C" void shim_closest(const Tree* tree, const int32_t* active, Rays* rays, Hits* hits, float offset,
                             uint32_t quads) {
    for (int i = 0; i < LANES; i++) {
        if (!active[i]) continue;
        const uint32_t found = tree->closest(*rays, i, offset, rays->tfar[i]);
        if (found == NONE) continue;
        hits->geom[i] = found < quads ? 0 : 1;
        hits->prim[i] = found < quads ? found : (found - quads) / 2;
    }
}

extern "C" void shim_occluded(const Tree* tree, const int32_t* active, Rays* rays, float offset) {
    for (int i = 0; i < LANES; i++)
        if (active[i] && tree->occluded(*rays, i, offset)) rays->tfar[i] = -INFINITY;
}
