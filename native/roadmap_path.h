// Paths of the oracle's tours as whole actions, as anm_mj/evaluation/oracle/segments.py, roadmap.py and discretize.py
// have them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace anm {

struct Point {
    double x, y;
};

// Where the robot can be, cell by cell; see ReachableArea in anm_mj/ground_truth/observable.py.
struct ClearanceGrid {
    const double* clearance;      // distance to the edge of the area [m]
    const std::int32_t* nearest;  // the place nearest to each cell
    std::int64_t rows, cols;
    double origin_x, origin_y, resolution;

    bool inside(std::int64_t row, std::int64_t col) const { return row >= 0 && col >= 0 && row < rows && col < cols; }
    std::int64_t cell(double at, double origin) const {
        return static_cast<std::int64_t>(std::floor((at - origin) / resolution));
    }
    double clearance_at(Point at) const {
        const std::int64_t row = cell(at.y, origin_y), col = cell(at.x, origin_x);
        return inside(row, col) ? clearance[row * cols + col] : 0.0;
    }
    std::int64_t nearest_at(Point at) const {
        const std::int64_t row = std::clamp<std::int64_t>(cell(at.y, origin_y), 0, rows - 1);
        const std::int64_t col = std::clamp<std::int64_t>(cell(at.x, origin_x), 0, cols - 1);
        return nearest[row * cols + col];
    }
};

// The constants of roadmap.py and discretize.py, in this order.
struct PathRule {
    double edge_clearance, sample, tolerance, clearance, clearance_cost, forward, turn;
};

// Straight legs in a row: turn to a heading, then move.
struct PathLeg {
    std::int64_t heading, moves;
};

// Whether the segment keeps the clearance of its ends, tested at `num` points.
inline bool segment_clear(const ClearanceGrid& grid, const PathRule& rule, Point a, Point b, std::int64_t num) {
    const double step = 1.0 / static_cast<double>(num - 1), dx = b.x - a.x, dy = b.y - a.y;
    const double first = grid.clearance_at(a), last = grid.clearance_at({a.x + dx, a.y + dy});
    const double wanted = std::min(std::min(first, last), rule.edge_clearance) - grid.resolution;
    const double enough = std::max(wanted, grid.resolution - 1e-9);
    if (first < enough || last < enough) return false;
    for (std::int64_t k = 1; k < num - 1; ++k) {
        const double share = static_cast<double>(k) * step;
        if (grid.clearance_at({a.x + share * dx, a.y + share * dy}) < enough) return false;
    }
    return true;
}

// The polyline without the corners that a clear segment can skip, and without its start: greedy, farthest first.
inline void shortcut(const ClearanceGrid& grid, const PathRule& rule, std::vector<Point>& line) {
    std::vector<Point> kept;
    const std::size_t count = line.size();
    for (std::size_t at = 0; at + 1 < count;) {
        double longest = 0.0;
        for (std::size_t k = at + 1; k < count; ++k) {
            const double dx = line[k].x - line[at].x, dy = line[k].y - line[at].y;
            longest = std::max(longest, std::sqrt(dx * dx + dy * dy));
        }
        const std::int64_t num = 2 + static_cast<std::int64_t>(longest / rule.sample);
        std::size_t next = count - 1;
        while (next > at + 1 && !segment_clear(grid, rule, line[at], line[next], num)) --next;
        kept.push_back(line[next]);
        at = next;
    }
    line.swap(kept);
}

// Least clearance on a straight row of moves, sampled at every other move and the last.
inline double least_clearance(const ClearanceGrid& grid, Point at, Point step, std::int64_t moves) {
    const double x = (at.x - grid.origin_x) / grid.resolution, y = (at.y - grid.origin_y) / grid.resolution;
    const double dx = step.x / grid.resolution, dy = step.y / grid.resolution;
    const auto after = [&](std::int64_t k) {
        const auto row = static_cast<std::int64_t>(std::floor(y + static_cast<double>(k) * dy));
        const auto col = static_cast<std::int64_t>(std::floor(x + static_cast<double>(k) * dx));
        return grid.inside(row, col) ? grid.clearance[row * grid.cols + col] : 0.0;
    };
    double least = after(moves);
    for (std::int64_t k = 2; k < moves && least > 0.0; k += 2) least = std::min(least, after(k));
    return least;
}

// Paths between places as the robot drives them: along headings, in whole moves.
class PathMaker {
  public:
    PathMaker(const ClearanceGrid& grid, const PathRule& rule, double yaw, std::int64_t num_headings)
        : grid_(grid), rule_(rule), yaw_(yaw), num_headings_(num_headings) {}

    // The legs from a place along corners.
    std::vector<PathLeg> legs(Point at, const std::vector<Point>& corners) const {
        std::vector<PathLeg> path;
        std::int64_t heading = -1;
        for (const Point& corner : corners) {
            std::vector<PathLeg> best;
            double least = std::numeric_limits<double>::infinity();
            for (auto& tried : candidates({corner.x - at.x, corner.y - at.y})) {
                const double cost = cost_of(at, heading, tried);
                if (cost < least) least = cost, best.swap(tried);
            }
            for (const PathLeg& leg : best) {
                if (!path.empty() && path.back().heading == leg.heading) {
                    path.back().moves += leg.moves;
                } else {
                    path.push_back(leg);
                }
                const Point ahead = direction(leg.heading);
                const double length = static_cast<double>(leg.moves) * rule_.forward;
                at = {at.x + length * ahead.x, at.y + length * ahead.y};
                heading = leg.heading;
            }
        }
        return path;
    }

    // Calls `see` with place and heading after every action of legs, without the turn to the first.
    template <class See>
    void drive(Point at, const std::vector<PathLeg>& path, const See& see) const {
        std::int64_t heading = path.front().heading;
        for (const PathLeg& leg : path) {
            const std::int64_t side = shorter_side(heading, leg.heading);
            while (heading != leg.heading) {
                heading = modulo(heading + side);
                see(grid_.nearest_at(at), heading);
            }
            const Point step = move(heading), from = at;
            for (std::int64_t k = 1; k <= leg.moves; ++k) {
                at = {from.x + static_cast<double>(k) * step.x, from.y + static_cast<double>(k) * step.y};
                see(grid_.nearest_at(at), heading);
            }
        }
    }

  private:
    std::int64_t modulo(std::int64_t heading) const { return (heading % num_headings_ + num_headings_) % num_headings_; }
    std::int64_t shorter_side(std::int64_t from, std::int64_t to) const {
        return modulo(to - from) <= num_headings_ / 2 ? 1 : -1;
    }
    Point direction(std::int64_t heading) const {
        const double angle = yaw_ + static_cast<double>(heading) * rule_.turn;
        return {std::cos(angle), std::sin(angle)};
    }
    Point move(std::int64_t heading) const {
        const Point ahead = direction(heading);
        return {rule_.forward * ahead.x, rule_.forward * ahead.y};
    }

    // Candidates for following a straight line.
    std::vector<std::vector<PathLeg>> candidates(Point delta) const {
        std::vector<std::vector<PathLeg>> found;
        const double length = std::hypot(delta.x, delta.y);
        if (length < rule_.tolerance) return found;
        const double tau = 2.0 * kPi;
        double bearing = std::remainder(std::atan2(delta.y, delta.x) - yaw_, tau);
        bearing = (bearing == -kPi ? kPi : bearing) / rule_.turn;
        const double low = std::floor(bearing);
        const double angles[2] = {(low - bearing) * rule_.turn, (low + 1.0 - bearing) * rule_.turn};
        const std::int64_t below = modulo(static_cast<std::int64_t>(low)), headings[2] = {below, modulo(below + 1)};
        for (int k = 0; k < 2; ++k) {
            if (length * std::sin(std::abs(angles[k])) > rule_.tolerance) continue;
            const auto moves = static_cast<std::int64_t>(std::nearbyint(length * std::cos(angles[k]) / rule_.forward));
            found.push_back({{headings[k], std::max<std::int64_t>(1, moves)}});
        }
        if (!found.empty()) return found;
        std::vector<PathLeg> both;
        for (int k = 0; k < 2; ++k) {
            const double along = length * std::abs(std::sin(angles[1 - k])) / std::sin(rule_.turn);
            const auto moves = static_cast<std::int64_t>(std::nearbyint(along / rule_.forward));
            if (moves > 0) both.push_back({headings[k], moves});
        }
        found.push_back(both);
        std::reverse(both.begin(), both.end());
        found.push_back(both);
        return found;
    }

    // Steps, and what too little clearance counts for; `heading` is -1 where the first turn makes no difference.
    double cost_of(Point at, std::int64_t heading, const std::vector<PathLeg>& tried) const {
        double clearance = std::numeric_limits<double>::infinity();
        std::int64_t steps = 0;
        for (const PathLeg& leg : tried) {
            const Point step = move(leg.heading);
            clearance = std::min(clearance, least_clearance(grid_, at, step, leg.moves));
            at = {at.x + static_cast<double>(leg.moves) * step.x, at.y + static_cast<double>(leg.moves) * step.y};
            if (heading >= 0) steps += modulo(shorter_side(heading, leg.heading) * (leg.heading - heading));
            steps += leg.moves;
            heading = leg.heading;
        }
        return static_cast<double>(steps) + rule_.clearance_cost * std::max(rule_.clearance - clearance, 0.0);
    }

    static constexpr double kPi = 3.14159265358979323846;
    ClearanceGrid grid_;
    PathRule rule_;
    double yaw_;
    std::int64_t num_headings_;
};

}  // namespace anm
