// Where contacts and grains lie in memory; labkit/engines/kernel/layout.py explains it and has the same numbers.
#pragma once
#include <cstdint>

constexpr int WIDTH = 64;  // contacts or grains per block, numbers per row
constexpr int LANES = 16;  // contacts or grains that are copied at once

// columns of the records of a site
constexpr int PLACE_COLUMNS = 4;
constexpr int SITE_W = 4, SITE_COLUMNS = 8;
constexpr int SITE_TORQUE = 4, FORCE_COLUMNS = 8;

// rows of a block of grains
constexpr int GRAIN_ROWS = 3, MASS_ROWS = 2;

// rows of the workspace of a domain
constexpr int D = 0, SQUARES = 4 * WIDTH, VREL = 5 * WIDTH, WA = 8 * WIDTH, WB = 12 * WIDTH;
constexpr int FORCE = 16 * WIDTH, TORQUE_A = 19 * WIDTH, TORQUE_B = 22 * WIDTH;
constexpr int CELL_WORK = 25 * WIDTH, SUM_ROWS = 8;
constexpr int GRAIN_FORCE = 33 * WIDTH, GRAIN_TORQUE = 36 * WIDTH, W = 39 * WIDTH, WORK_ROWS = 43;

// rows of the double-precision workspace of a domain
constexpr int X = 0, SPEED2 = 5 * WIDTH, CONTACT_SUMS = 6 * WIDTH, DOUBLE_ROWS = 14;

// The lengths of the arrays, in the order of labkit.engines.kernel.layout.SIZES.
struct Sizes {
    int64_t domains, ends, grains, grain_blocks, sites, images, slots, blocks, block_size;
};

// The arrays of labkit.engines.kernel.layout.Arrays; T is the type of the numbers that may be single.
// A pointer takes 8 bytes on any computer, as in the tables that the compiled functions read.
template <class T> struct Arrays {
    alignas(8) const int64_t *grain_first, *contact_first, *contact_last;
    alignas(8) double *places;
    alignas(8) T *motions, *forces;
    alignas(8) double *grains;
    alignas(8) const T *masses;
    alignas(8) const int64_t *image_first, *owner;
    alignas(8) const double *shift;
    alignas(8) const uint32_t *pairs;
    alignas(8) T *blocks, *work;
    alignas(8) double *doubles;
    alignas(8) const double *start;
    alignas(8) const Sizes *sizes;

    T *workspace(int64_t domain) const { return work + domain * WORK_ROWS * WIDTH; }
    double *double_workspace(int64_t domain) const { return doubles + domain * DOUBLE_ROWS * WIDTH; }
    int64_t first_image() const { return sizes->sites - 1 - sizes->images; }  // after whole blocks of grains
};
