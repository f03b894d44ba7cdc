// What a tour of the oracle covers, as anm_mj/evaluation/oracle/tour_annealing.py has it.
#pragma once

#include <cstdint>

namespace anm {

// Numbers of turns and paths, -1 where one was not made yet; see anm_mj/evaluation/oracle/segments.py.
struct TourSegments {
    const std::int32_t* turns;  // [place][from yaw][to yaw][side: right, left]
    const std::int32_t* paths;  // [from place][to place]
    const std::int8_t* yaws;    // [segment][first, last]; -1 where a path makes no move
    const std::int64_t* steps;  // [segment]
    std::int64_t num_places, num_headings;

    const std::int32_t* turn(std::int64_t place, std::int64_t from, std::int64_t to, std::int64_t side) const {
        return turns + (((place * num_headings + from) * num_headings + to) * 2 + (side > 0 ? 1 : 0));
    }
    std::int64_t shorter_side(std::int64_t from, std::int64_t to) const {
        return (to - from + num_headings) % num_headings <= num_headings / 2 ? 1 : -1;
    }
};

// A segment that has to be made: a turn at a place from a yaw to a yaw by a side, or, with side 0, a path.
struct Wanted {
    std::int64_t place, from, to, side;
};

// The numbers of a tour's segments, at most three for a stop and one more; -1 where one of them was not made yet. The
// first stop that begins at the end of the budget or later ends the tour: `num_stops` becomes the number of those before.
inline std::int64_t tour_segments(const TourSegments& made, const std::int64_t* stops, std::int64_t& num_stops,
                                  std::int64_t budget, std::int64_t place, std::int64_t yaw, std::int64_t* numbers,
                                  Wanted& wanted) {
    std::int64_t count = 0, total = 0;
    const auto add = [&](std::int32_t number, const Wanted& what) {
        if (number < 0) {
            wanted = what;
            return false;
        }
        numbers[count++] = number;
        total += made.steps[number];
        return true;
    };
    const auto turn_to = [&](std::int64_t to, std::int64_t side) {
        const bool known = add(*made.turn(place, yaw, to, side), {place, yaw, to, side});
        yaw = to;
        return known;
    };
    if (!turn_to(yaw, 1)) return -1;
    for (std::int64_t k = 0; k < num_stops; ++k) {
        if (total >= budget) {
            num_stops = k;
            break;
        }
        const std::int64_t to = stops[3 * k], towards = stops[3 * k + 1], side = stops[3 * k + 2];
        if (to != place) {
            const std::int32_t path = made.paths[place * made.num_places + to];
            const std::int64_t first = path < 0 ? yaw : made.yaws[2 * path];
            if (first >= 0) {
                if (first != yaw && !turn_to(first, made.shorter_side(yaw, first))) return -1;
                if (!add(path, {place, 0, to, 0})) return -1;
                yaw = made.yaws[2 * path + 1];
            }
            place = to;
        }
        if (towards >= 0 && towards != yaw && !turn_to(towards, side)) return -1;
    }
    return count;
}

// Ors the bits of segments one after the other, and counts them after each.
inline void tour_counts(const std::uint64_t* covers, std::int64_t num_words, const std::int64_t* numbers,
                        std::int64_t count, std::uint64_t* seen, std::int64_t* covered) {
    const auto bits_of = [](std::uint64_t word) {
        std::int64_t bits = 0;
        for (; word != 0; word &= word - 1) ++bits;
        return bits;
    };
    std::int64_t total = 0;
    for (std::int64_t word = 0; word < num_words; ++word) total += bits_of(seen[word]);
    for (std::int64_t k = 0; k < count; ++k) {
        const std::uint64_t* cover = covers + numbers[k] * num_words;
        for (std::int64_t word = 0; word < num_words; ++word) {
            // Most of what a frame shows was seen before.
            const std::uint64_t fresh = cover[word] & ~seen[word];
            if (fresh == 0) continue;
            seen[word] |= fresh;
            total += bits_of(fresh);
        }
        covered[k] = total;
    }
}

}  // namespace anm
