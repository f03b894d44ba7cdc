// What the planner reads off its maps, as Python sees it.
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include "bindings.h"
#include "gain_rays.h"
#include "plane_maps.h"
#include "pooled_cells.h"
#include "roadmap_path.h"
#include "tour.h"

namespace {

using Cells = Array<std::int8_t, 3>;
using ConstCells = Array<const std::int8_t, 3>;
using Indices = Array<const std::int64_t, 1>;
using Numbers = Array<const double, 1>;

template <class Grid>
anm::Extent extent_of(const Grid& grid) {
    return {static_cast<std::int64_t>(grid.shape(0)), static_cast<std::int64_t>(grid.shape(1)),
            static_cast<std::int64_t>(grid.shape(2))};
}

// See pooled_cells.h; begins and ends of the rows and columns that have changed, or None.
nb::object pool_window(ConstCells state, Indices low, Indices shape, std::int64_t floor, Cells out, Indices to,
                       Array<std::int64_t, 1> num_free, Array<std::int64_t, 1> num_surface) {
    require(low.size() == 3 && shape.size() == 3 && to.size() == 3, "a window has three axes");
    const anm::Extent size = extent_of(out);
    const anm::PoolWindow window{extent_of(state), {low(0), low(1), low(2)}, {shape(0), shape(1), shape(2)}};
    const anm::Extent& cells = window.cells;
    require(cells.layers >= 0 && cells.rows >= 2 && cells.cols >= 2, "the window has an edge");
    require(to(0) >= 0 && to(1) >= 0 && to(2) >= 0 && to(0) + cells.layers <= size.layers &&
                to(1) + cells.rows - 2 <= size.rows && to(2) + cells.cols - 2 <= size.cols,
            "the window lies outside the cells");
    require(num_free.size() == out.shape(0) && num_surface.size() == out.shape(0), "each layer is counted");
    const anm::Changed changed = anm::pool_window(state.data(), window, floor, out.data(), size, to.data(),
                                                  num_free.data(), num_surface.data());
    if (changed.row_begin >= changed.row_end) return nb::none();
    return nb::make_tuple(changed.row_begin, changed.row_end, changed.col_begin, changed.col_end);
}

// Casts the rays of some rows again where the cells that they hit have changed; see gain_rays.h.
void cast_rays(ConstCells cells, Array<const std::int64_t, 2> offset, Indices start, Array<const std::int32_t, 1> rows,
               Array<std::int32_t, 2> hit, Array<std::int8_t, 2> state, Array<std::uint8_t, 2> sample,
               Array<std::uint8_t, 2> depth) {
    const std::size_t num_rows = hit.shape(0), num_rays = hit.shape(1);
    const auto fits = [&](const auto& array) { return array.shape(0) == num_rows && array.shape(1) == num_rays; };
    require(fits(state) && fits(sample) && fits(depth) && offset.shape(0) == num_rays && start.size() == num_rows,
            "the arrays differ in size");
    require(offset.shape(1) >= 1 && offset.shape(1) <= 256, "a ray has 1 to 256 samples");
    const anm::RayRows rays{hit.data(),
                            state.data(),
                            sample.data(),
                            depth.data(),
                            static_cast<std::int64_t>(num_rays),
                            static_cast<std::int64_t>(offset.shape(1)),
                            start.data(),
                            offset.data()};
    for (std::size_t i = 0; i < rows.size(); ++i) {
        require(rows(i) >= 0 && static_cast<std::size_t>(rows(i)) < num_rows, "there is no such row");
        require(anm::cast_row(cells.data(), static_cast<std::int64_t>(cells.size()), rays, rows(i)),
                "a ray leaves the cells");
    }
}

// See gain_rays.h; `rule` holds the numbers of GainRule.
void ray_gains(Array<const std::int32_t, 2> hit, Array<const std::int8_t, 2> state, Array<const std::uint8_t, 2> sample,
               Array<const std::uint8_t, 2> depth, InFlat distance, InFlat layer_share, Array<const float, 3> tried,
               InFlat rule, Array<float, 2> gain) {
    require(state.size() == hit.size() && sample.size() == hit.size() && depth.size() == hit.size() &&
                gain.size() == hit.size() && layer_share.size() == tried.shape(0) && rule.size() == 5,
            "the arrays differ in size");
    for (std::size_t i = 0; i < hit.size(); ++i) {
        require(hit.data()[i] >= 0 && static_cast<std::size_t>(hit.data()[i]) < tried.size() &&
                    sample.data()[i] < distance.size(),
                "a ray leaves the cells");
    }
    const anm::GainRule numbers{rule(0), rule(1), rule(2), rule(3), rule(4)};
    anm::ray_gains(hit.data(), state.data(), sample.data(), depth.data(), static_cast<std::int64_t>(hit.size()),
                   distance.data(), layer_share.data(), static_cast<std::int64_t>(tried.shape(1) * tried.shape(2)),
                   tried.data(), numbers, gain.data());
}

// See gain_rays.h; `frame` holds x, y and z of the cells' outer corner, their edge, and the least and largest z.
void first_closed(ConstCells cells, Numbers frame, Numbers from, Array<const double, 2> direction, Numbers distance,
                  Array<std::int64_t, 1> cell, Array<std::int64_t, 1> sample) {
    require(frame.size() == 6 && from.size() == 3 && direction.shape(1) == 3, "a place has three coordinates");
    require(cell.size() == direction.shape(0) && sample.size() == direction.shape(0), "the arrays differ in size");
    const anm::CellFrame numbers{{frame(0), frame(1), frame(2)}, frame(3), frame(4), frame(5), extent_of(cells)};
    require(anm::first_closed(cells.data(), numbers, from.data(), direction.data(),
                              static_cast<std::int64_t>(direction.shape(0)), distance.data(),
                              static_cast<std::int64_t>(distance.size()), cell.data(), sample.data()),
            "a ray leaves the cells");
}

Out capped_distances(Array<const std::uint8_t, 2> free, int cap) {
    require(cap >= 0 && cap <= anm::kLargestCap, "the cap is too large");
    float* distance = nullptr;
    Out out = make_array({free.shape(0), free.shape(1)}, distance);
    anm::capped_distances(free.data(), static_cast<std::int64_t>(free.shape(0)),
                          static_cast<std::int64_t>(free.shape(1)), cap, distance);
    return out;
}

void small_components(Array<const std::uint8_t, 2> mask, double most, Array<std::uint8_t, 2> out) {
    require(out.shape(0) == mask.shape(0) && out.shape(1) == mask.shape(1), "the arrays differ in size");
    anm::small_components(mask.data(), static_cast<std::int64_t>(mask.shape(0)),
                          static_cast<std::int64_t>(mask.shape(1)), most, out.data());
}

void connected_components(Array<const std::int64_t, 2> links, Array<std::int64_t, 1> component) {
    require(links.shape(1) == 2, "a link has two ends");
    const auto num = static_cast<std::int64_t>(component.size());
    for (std::size_t i = 0; i < links.size(); ++i) {
        require(links.data()[i] >= 0 && links.data()[i] < num, "there is no such node");
    }
    anm::connected_components(links.data(), static_cast<std::int64_t>(links.shape(0)), num, component.data());
}

// See tour.h; `start` holds place and yaw. The numbers of segments and of stops within the budget, or -1 where `wanted`
// names a segment that is to be made.
std::pair<std::int64_t, std::int64_t> tour_coverage(
    Array<const std::int64_t, 2> stops, Indices start, std::int64_t budget, Array<const std::int32_t, 4> turns,
    Array<const std::int32_t, 2> paths, Array<const std::int8_t, 2> yaws, Array<const std::int64_t, 1> steps,
    Array<const std::uint64_t, 2> covers, Array<std::uint64_t, 1> seen, Array<std::int64_t, 1> numbers,
    Array<std::int64_t, 1> covered, Array<std::int64_t, 1> wanted) {
    const auto places = static_cast<std::int64_t>(turns.shape(0)), headings = static_cast<std::int64_t>(turns.shape(1));
    auto num_stops = static_cast<std::int64_t>(stops.shape(0));
    require(turns.shape(2) == turns.shape(1) && turns.shape(3) == 2 && paths.shape(0) == turns.shape(0) &&
                paths.shape(1) == turns.shape(0) && yaws.shape(0) == covers.shape(0) && yaws.shape(1) == 2 &&
                steps.size() == covers.shape(0) && stops.shape(1) == 3 && seen.size() == covers.shape(1) && start.size() == 2 && wanted.size() == 4 &&
                static_cast<std::int64_t>(numbers.size()) == 3 * num_stops + 1 && covered.size() == numbers.size(),
            "the arrays differ in size");
    require(start(0) >= 0 && start(0) < places && start(1) >= 0 && start(1) < headings, "the start is none");
    for (std::int64_t k = 0; k < num_stops; ++k) {
        const std::int64_t* stop = stops.data() + 3 * k;
        require(stop[0] >= 0 && stop[0] < places && stop[1] >= -1 && stop[1] < headings, "a stop is none");
    }
    const anm::TourSegments made{turns.data(), paths.data(), yaws.data(), steps.data(), places, headings};
    anm::Wanted missing{};
    const std::int64_t count =
        anm::tour_segments(made, stops.data(), num_stops, budget, start(0), start(1), numbers.data(), missing);
    if (count < 0) {
        wanted(0) = missing.place, wanted(1) = missing.from, wanted(2) = missing.to, wanted(3) = missing.side;
        return {-1, 0};
    }
    anm::tour_counts(covers.data(), static_cast<std::int64_t>(covers.shape(1)), numbers.data(), count, seen.data(),
                     covered.data());
    return {count, num_stops};
}

// See roadmap_path.h. `before` holds the place before each on the path from `ends(0)`; `frame` holds origin x and y of
// the grid, its resolution and yaw 0, `rule` the numbers of PathRule. Steps, first and last heading; -1 where no move is
// made.
std::tuple<std::int64_t, std::int64_t, std::int64_t> roadmap_path(
    Indices ends, Array<const std::int32_t, 1> before, Array<const double, 2> places,
    Array<const double, 2> clearance, Array<const std::int32_t, 1> nearest, Numbers frame, Numbers rule,
    Array<const std::uint64_t, 3> bits, Array<std::uint64_t, 1> cover) {
    const auto num_places = static_cast<std::int64_t>(places.shape(0));
    const auto headings = static_cast<std::int64_t>(bits.shape(1)), words = static_cast<std::int64_t>(bits.shape(2));
    require(ends.size() == 2 && places.shape(1) == 2 && before.size() == places.shape(0) && frame.size() == 4 &&
                rule.size() == 7 && nearest.size() == clearance.size() && clearance.size() > 0 &&
                bits.shape(0) == places.shape(0) && cover.size() == bits.shape(2),
            "the arrays differ in size");
    std::vector<anm::Point> line;
    std::int64_t at = ends(1);
    for (std::int64_t k = 0;; ++k) {
        require(at >= 0 && at < num_places && k < num_places, "there is no path");
        line.push_back({places(at, 0), places(at, 1)});
        if (at == ends(0)) break;
        at = before(at);
    }
    std::reverse(line.begin(), line.end());
    const anm::Point start = line.front();
    const anm::ClearanceGrid grid{clearance.data(), nearest.data(), static_cast<std::int64_t>(clearance.shape(0)),
                                  static_cast<std::int64_t>(clearance.shape(1)), frame(0), frame(1), frame(2)};
    const anm::PathRule numbers{rule(0), rule(1), rule(2), rule(3), rule(4), rule(5), rule(6)};
    anm::shortcut(grid, numbers, line);
    const anm::PathMaker maker(grid, numbers, frame(3), headings);
    const std::vector<anm::PathLeg> legs = maker.legs(start, line);
    if (legs.empty()) return {0, -1, -1};
    std::int64_t steps = 0;
    maker.drive(start, legs, [&](std::int64_t place, std::int64_t heading) {
        require(place >= 0 && place < num_places, "a cell has no place");
        const std::uint64_t* seen = bits.data() + (place * headings + heading) * words;
        for (std::int64_t word = 0; word < words; ++word) cover(word) |= seen[word];
        ++steps;
    });
    return {steps, legs.front().heading, legs.back().heading};
}

}  // namespace

void bind_planning(nb::module_& m) {
    m.def("pool_window", &pool_window, "state"_a, "low"_a, "shape"_a, "floor"_a, "out"_a, "to"_a, "num_free"_a,
          "num_surface"_a);
    m.def("cast_rays", &cast_rays, "cells"_a, "offset"_a, "start"_a, "rows"_a, "hit"_a, "state"_a, "sample"_a,
          "depth"_a);
    m.def("ray_gains", &ray_gains, "hit"_a, "state"_a, "sample"_a, "depth"_a, "distance"_a, "layer_share"_a, "tried"_a,
          "rule"_a, "gain"_a);
    m.def("first_closed", &first_closed, "cells"_a, "frame"_a, "start"_a, "direction"_a, "distance"_a, "cell"_a,
          "sample"_a);
    m.def("capped_distances", &capped_distances, "free"_a, "cap"_a);
    m.def("small_components", &small_components, "mask"_a, "most"_a, "out"_a);
    m.def("connected_components", &connected_components, "links"_a, "component"_a);
    m.def("tour_coverage", &tour_coverage, "stops"_a, "start"_a, "budget"_a, "turns"_a, "paths"_a, "yaws"_a, "steps"_a,
          "covers"_a, "seen"_a, "numbers"_a, "covered"_a, "wanted"_a);
    m.def("roadmap_path", &roadmap_path, "ends"_a, "before"_a, "places"_a, "clearance"_a, "nearest"_a, "frame"_a,
          "rule"_a, "bits"_a, "cover"_a);
}
