// Loops of a neighbour search; labkit/engines/kernel/neighbours.py and packing.py call them and explain their arrays.
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>
#include "vectors.hpp"

namespace {  // of each level of instructions

constexpr int LOST = 1000;  // periods; a grain farther away is treated as lost

// Sort integers from 0 to most - 1 by counting; equal integers keep their order. order[start[k]] to
// order[start[k + 1] - 1] are the entries equal to k.
template <class Index> void sort_by_number(const Index *numbers, int64_t n, int64_t most, int64_t *start, int64_t *order) {
    std::fill(start, start + most + 1, 0);
    for (int64_t k = 0; k < n; k++) start[numbers[k] + 1]++;
    for (int64_t k = 0; k < most; k++) start[k + 1] += start[k];
    std::vector<int64_t> free(start, start + most + 1);
    for (int64_t k = 0; k < n; k++) order[free[numbers[k]]++] = k;
}

// Write the period (grain, 3) and the cell of the grid (grain,) of each grain. Returns false if a grain is lost: its
// position is NaN or too far away.
inline bool place_in_grid(const double *position, int64_t grains, const double *inverse_cell, const int64_t *shape,
                          int64_t *period, int64_t *grid_cell) {
    for (int64_t g = 0; g < grains; g++) {
        int64_t index = 0;
        for (int k = 2; k >= 0; k--) {
            double fraction = 0;
            for (int j = 0; j < 3; j++) fraction = fused(inverse_cell[3 * k + j], position[3 * g + j], fraction);
            if (!(std::fabs(fraction) < LOST)) return false;
            const double whole = std::floor(fraction);
            period[3 * g + k] = int64_t(whole);
            index = index * shape[k] + std::min(int64_t((fraction - whole) * shape[k]), shape[k] - 1);
        }
        grid_cell[g] = index;
    }
    return true;
}

// Consecutive cells of the grid, from `first` to `last`, and their period.
struct Run { int64_t first, last, period[3]; };

inline int64_t floor_of(int64_t a, int64_t b) { return a / b - (a % b < 0); }

// Find the cells after cell c within `span` (3,), in order; the first run starts with c itself.
inline void runs_around(int64_t c, const int64_t *shape, const int64_t *span, std::vector<Run> &runs) {
    const int64_t at[3] = {c % shape[0], c / shape[0] % shape[1], c / (shape[0] * shape[1])};
    runs.clear();
    for (int64_t z = 0; z <= span[2]; z++)
        for (int64_t y = z > 0 ? -span[1] : 0; y <= span[1]; y++)
            for (int64_t x = z > 0 || y > 0 ? -span[0] : 0; x <= span[0]; x++) {
                const int64_t to[3] = {at[0] + x, at[1] + y, at[2] + z};
                int64_t period[3], index = 0;
                for (int k = 2; k >= 0; k--) {
                    period[k] = floor_of(to[k], shape[k]);
                    index = index * shape[k] + to[k] - period[k] * shape[k];
                }
                Run *last = runs.empty() ? nullptr : &runs.back();
                if (last && index == last->last + 1 && std::equal(period, period + 3, last->period)) last->last = index;
                else runs.push_back({index, index, {period[0], period[1], period[2]}});
            }
}

// Find all pairs of grains whose surfaces are closer than `cutoff`; return their number, or -1 without enough room.
// grains: positions in the cell, and radii, (n, 4), sorted by the cells of the grid; start: first of each cell.
inline int64_t find_pairs(const double *grains, const double *cell, const int64_t *period, const int64_t *start,
                          int64_t cells, const int64_t *shape, const int64_t *span, double cutoff, int32_t *first,
                          int32_t *second, int32_t *shift, int64_t capacity) {
    int64_t count = 0;
    std::vector<Run> runs;
    std::vector<double> corners;  // corners of the periods of the runs
    for (int64_t c = 0; c < cells; c++) {
        if (start[c] == start[c + 1]) continue;
        runs_around(c, shape, span, runs);
        corners.clear();
        for (const Run &run : runs)
            for (int k = 0; k < 3; k++) {
                const double *row = cell + 3 * k;
                const double plane = fused(row[0], double(run.period[0]), row[1] * run.period[1]);
                corners.push_back(fused(row[2], double(run.period[2]), plane));
            }
        for (int64_t a = start[c]; a < start[c + 1]; a++) {
            const double *grain = grains + 4 * a, reach_a = grain[3] + cutoff;
            const int64_t found = count;
            for (size_t r = 0; r < runs.size(); r++) {
                const double *corner = corners.data() + 3 * r;
                const double x = grain[0] - corner[0], y = grain[1] - corner[1], z = grain[2] - corner[2];
                const int64_t begin = r == 0 ? a + 1 : start[runs[r].first], end = start[runs[r].last + 1];
                if (count + end - begin > capacity) return -1;
                for (int64_t b = begin; b < end; b++) {  // without branches, which the processor could not predict
                    const double *other = grains + 4 * b, reach = reach_a + other[3];
                    const double dx = other[0] - x, dy = other[1] - y, dz = other[2] - z;
                    first[count] = int32_t(r), second[count] = int32_t(b);
                    count += fused(dz, dz, fused(dx, dx, dy * dy)) < reach * reach;
                }
            }
            for (int64_t pair = found; pair < count; pair++) {
                const Run &run = runs[first[pair]];
                first[pair] = int32_t(a);
                for (int k = 0; k < 3; k++)
                    shift[3 * pair + k] = int32_t(run.period[k] + period[3 * a + k] - period[3 * int64_t(second[pair]) + k]);
            }
        }
    }
    return count;
}

// Return -1 if a pair must be reversed so that the smaller index comes first, otherwise 1. For a grain and its own
// image, the shift of the second grain decides.
inline int reversal(int64_t first, int64_t second, const int32_t *shift) {
    if (first != second) return first > second ? -1 : 1;
    for (int k = 0; k < 3; k++) if (shift[k] != 0) return shift[k] < 0 ? -1 : 1;
    return 1;
}

// The contacts before the search: grains (2, n), periodic shifts (n, 3) and history (n, rows).
template <class T> struct Past {
    const int32_t *pairs, *shift;
    const T *history;
    int64_t n, rows;
    std::vector<int64_t> start, entries;  // sorted by the smaller index

    void sort(int64_t grains) {
        std::vector<int32_t> lower(n);
        for (int64_t k = 0; k < n; k++) lower[k] = std::min(pairs[k], pairs[n + k]);
        start.resize(grains + 1), entries.resize(n);
        sort_by_number(lower.data(), n, grains, start.data(), entries.data());
    }

    // Return the index of a pair, or -1; `sign` is -1 if its grains are in the opposite order.
    int64_t find(int64_t first, int64_t second, const int32_t *s, int *sign) const {
        const int turn = reversal(first, second, s);
        const int64_t lower = std::min(first, second);
        for (int64_t e = start[lower]; e < start[lower + 1]; e++) {
            const int64_t old = entries[e];
            if (int64_t(pairs[old]) + pairs[n + old] != first + second) continue;
            const int32_t *o = shift + 3 * old;
            *sign = turn * reversal(pairs[old], pairs[n + old], o);
            if (o[0] == *sign * s[0] && o[1] == *sign * s[1] && o[2] == *sign * s[2]) return old;
        }
        return -1;
    }
};

// Write stiffness and history of new pairs into blocks; pairs without history get zeros, and contacts that pad a
// block get a stiffness of 1. number: index in the history of each grain of the new pairs; slot: place of each new pair
// in the blocks; odd: 1 for each row of history whose sign changes with the order of the grains.
template <class T>
void carry_history(Past<T> past, const int8_t *odd, const int64_t *number, int64_t grains, const int32_t *pairs,
                   const int32_t *shift, const int64_t *slot, int64_t n, const double *stiffness, T *blocks, int64_t block_count) {
    const int64_t size = (1 + past.rows) * WIDTH;
    for (int64_t block = 0; block < block_count; block++) std::fill(blocks + block * size, blocks + block * size + WIDTH, T(1));
    past.sort(grains);
    int64_t next = 0;  // the order of the pairs hardly changes from one search to the next: try this pair first
    for (int64_t pair = 0; pair < n; pair++) {
        T *to = blocks + slot[pair] / WIDTH * size + slot[pair] % WIDTH;
        const int64_t first = number[pairs[pair]], second = number[pairs[n + pair]];
        const int32_t *s = shift + 3 * pair;
        int sign = 1;
        const bool same = next < past.n && past.pairs[next] == first && past.pairs[past.n + next] == second
                          && std::equal(s, s + 3, past.shift + 3 * next);
        const int64_t found = same ? next : past.find(first, second, s, &sign);
        to[0] = T(stiffness[pair]);
        for (int64_t k = 0; k < past.rows; k++)
            to[(1 + k) * WIDTH] = found < 0 ? T(0) : (odd[k] ? sign : 1) * past.history[found * past.rows + k];
        if (found >= 0) next = found + 1;
    }
}

// Return the values (n, rows) at the places `slot` (n,) in blocks of `size` numbers; the first row starts at `first`.
template <class T>
void take_rows(const T *blocks, int64_t size, int64_t first, const int64_t *slot, int64_t n, int64_t rows, T *values) {
    for (int64_t k = 0; k < n; k++) {
        const T *from = blocks + slot[k] / WIDTH * size + first + slot[k] % WIDTH;
        for (int64_t j = 0; j < rows; j++) values[k * rows + j] = from[j * WIDTH];
    }
}

// Write the indices of the pairs (n, 2) of grains that overlap or touch; return their number.
inline int64_t find_touching(const int64_t *pairs, const int32_t *shift, int64_t n, const double *position,
                             const double *radius, const double *cell, int64_t *found) {
    int64_t count = 0;
    for (int64_t pair = 0; pair < n; pair++) {
        const int64_t a = pairs[2 * pair], b = pairs[2 * pair + 1];
        double squared = 0;
        for (int j = 0; j < 3; j++) {
            const double *row = cell + 3 * j;
            const int32_t *s = shift + 3 * pair;
            const double plane = fused(row[0], double(s[0]), row[1] * s[1]);
            const double d = position[3 * b + j] + fused(row[2], double(s[2]), plane) - position[3 * a + j];
            squared = fused(d, d, squared);
        }
        if (radius[a] + radius[b] - std::sqrt(squared) >= 0) found[count++] = pair;
    }
    return count;
}

}  // namespace
