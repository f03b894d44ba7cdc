// Distances of places to the nearest of many triangles, as anm_mj/evaluation/surface_distance.py has it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "box_tree.h"

namespace anm {

struct Vector {
    double x, y, z;
};
inline Vector operator-(const Vector& a, const Vector& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline double dot(const Vector& a, const Vector& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vector cross(const Vector& a, const Vector& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

struct Triangle {
    Vector corner[3];
};

// To the plane where the place projects inside, else to an edge.
inline double squared_to_triangle(const Vector& p, const Triangle& triangle) {
    const Vector* corner = triangle.corner;
    const Vector normal = cross(corner[1] - corner[0], corner[2] - corner[0]);
    const double norm = dot(normal, normal);
    bool inside = norm > 0.0;
    double to_edge = Box::kInfinity;
    for (int k = 0; k < 3; ++k) {
        const Vector edge = corner[(k + 1) % 3] - corner[k], off = p - corner[k];
        inside = inside && dot(cross(edge, off), normal) >= 0.0;
        const double length = dot(edge, edge);
        const double along = std::min(1.0, std::max(0.0, dot(off, edge) / (length > 0.0 ? length : 1.0)));
        const Vector rest{off.x - along * edge.x, off.y - along * edge.y, off.z - along * edge.z};
        to_edge = std::min(to_edge, dot(rest, rest));
    }
    if (!inside) return to_edge;
    const double height = dot(p - corner[0], normal);
    return height * height / norm;
}

class TriangleTree {
public:
    // Of finite triangles: nine numbers each.
    TriangleTree(const double* corners, std::int64_t count) : tree_(sorted(corners, static_cast<std::size_t>(count))) {}

    // Distance of each place to the nearest triangle. Places in a row should be neighbours.
    void distances(const double* places, double* distance, std::int64_t count) const {
        std::size_t last = 0;
        for (std::int64_t i = 0; i < count; ++i) {
            const double* place = places + 3 * i;
            const Vector p{place[0], place[1], place[2]};
            // The last place's nearest triangle is likely to be near to this one.
            double best = squared_to_triangle(p, triangles_[last]);
            tree_.search(place, best, [&](std::uint32_t begin, std::uint32_t end) {
                for (std::uint32_t k = begin; k < end; ++k) {
                    if (squared_to_box(boxes_[k], place) >= best) continue;
                    const double square = squared_to_triangle(p, triangles_[k]);
                    if (square < best) best = square, last = k;
                }
            });
            distance[i] = std::sqrt(best);
        }
    }

private:
    static constexpr std::uint32_t kLeaf = 4;

    BoxTree sorted(const double* corners, std::size_t n) {
        std::vector<std::uint32_t> code(n), order(n);
        std::vector<double> middle(3 * n);
        for (std::size_t i = 0; i < n; ++i) {
            const double* at = corners + 9 * i;
            for (std::size_t axis = 0; axis < 3; ++axis) {
                middle[3 * i + axis] = (at[axis] + at[3 + axis] + at[6 + axis]) / 3.0;
            }
        }
        morton_order(middle.data(), code, order);
        triangles_.resize(n);
        boxes_.resize(n);
        for (std::size_t i = 0; i < n; ++i) {
            for (std::size_t k = 0; k < 3; ++k) {
                const double* at = corners + 9 * order[i] + 3 * k;
                triangles_[i].corner[k] = {at[0], at[1], at[2]};
                for (int axis = 0; axis < 3; ++axis) boxes_[i].take(axis, at[axis], at[axis]);
            }
        }
        return {code, kLeaf, [this](std::uint32_t i) { return boxes_[i]; }};
    }

    // Before the tree, which is made from them.
    std::vector<Triangle> triangles_;
    std::vector<Box> boxes_;
    BoxTree tree_;
};

}  // namespace anm
