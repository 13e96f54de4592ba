// The functions of the host that labkit calls (labkit/engines/kernel/host.py). This file is compiled once for each
// level of instructions, LEVEL, and the library contains all levels: v3 and v4 for x86-64, and `plain`.
#include <new>
#include "loop.hpp"
#include "search.hpp"

#define JOIN(a, b) a##_##b
#define NAMED(name, level) JOIN(name, level)
#define AT_LEVEL(name) NAMED(name, LEVEL)
#define EXPORT extern "C" __attribute__((visibility("default")))

constexpr int64_t NO_MEMORY = INT64_MIN;  // returned instead of an exception, which would end the process

template <class Work> int64_t guarded(Work work) {
#ifdef __cpp_exceptions
    try {
        return work();
    } catch (const std::bad_alloc &) {
        return NO_MEMORY;
    }
#else  // WebAssembly, where a page without memory ends
    return work();
#endif
}

#define FOR_BOTH_PRECISIONS(T, kind)                                                                                      \
    EXPORT int64_t AT_LEVEL(advance_##kind)(const Loop<T> *loop, const Plan *plan, int64_t steps, int64_t moved,          \
                                            double dt, int64_t threads, bool *search) {                                  \
        return guarded([&] { return advance(*loop, *plan, steps, moved, dt, int(threads), search); });                   \
    }                                                                                                                     \
    EXPORT int64_t AT_LEVEL(branch_force_##kind)(const Loop<T> *loop) {                                                   \
        return guarded([&] {                                                                                              \
            std::vector<double> sums;                                                                                     \
            branch_force(*loop, sums);                                                                                    \
            return 0;                                                                                                     \
        });                                                                                                               \
    }                                                                                                                     \
    EXPORT int64_t AT_LEVEL(place_images_##kind)(const Arrays<T> *arrays, const double *cell, const double *drift) {     \
        for (int64_t d = 0; d < arrays->sizes->domains; d++) place_images(*arrays, d, cell, drift);                      \
        return 0;                                                                                                         \
    }                                                                                                                     \
    EXPORT int64_t AT_LEVEL(carry_history_##kind)(                                                                        \
        const int32_t *old_pairs, const int32_t *old_shift, const T *history, int64_t old_n, int64_t rows,               \
        const int8_t *odd, const int64_t *number, int64_t grains, const int32_t *pairs, const int32_t *shift,            \
        const int64_t *slot, int64_t n, const double *stiffness, T *blocks, int64_t block_count) {                       \
        return guarded([&] {                                                                                              \
            carry_history<T>({old_pairs, old_shift, history, old_n, rows, {}, {}}, odd, number, grains, pairs, shift,    \
                             slot, n, stiffness, blocks, block_count);                                                    \
            return 0;                                                                                                     \
        });                                                                                                               \
    }                                                                                                                     \
    EXPORT int64_t AT_LEVEL(take_rows_##kind)(const T *blocks, int64_t size, int64_t first, const int64_t *slot,         \
                                              int64_t n, int64_t rows, T *values) {                                       \
        take_rows(blocks, size, first, slot, n, rows, values);                                                           \
        return 0;                                                                                                         \
    }

FOR_BOTH_PRECISIONS(double, double)
FOR_BOTH_PRECISIONS(float, single)

EXPORT int64_t AT_LEVEL(sort_by_number)(const int64_t *numbers, int64_t n, int64_t most, int64_t *start, int64_t *order) {
    return guarded([&] { sort_by_number(numbers, n, most, start, order); return 0; });
}
EXPORT int64_t AT_LEVEL(place_in_grid)(const double *position, int64_t grains, const double *inverse_cell,
                                       const int64_t *shape, int64_t *period, int64_t *grid_cell) {
    return place_in_grid(position, grains, inverse_cell, shape, period, grid_cell);
}
EXPORT int64_t AT_LEVEL(find_pairs)(const double *grains, const double *cell, const int64_t *period, const int64_t *start,
                                    int64_t cells, const int64_t *shape, const int64_t *span, double margin,
                                    int32_t *first, int32_t *second, int32_t *shift, int64_t capacity) {
    return guarded([&] {
        return find_pairs(grains, cell, period, start, cells, shape, span, margin, first, second, shift, capacity);
    });
}
EXPORT int64_t AT_LEVEL(find_touching)(const int64_t *pairs, const int32_t *shift, int64_t n, const double *position,
                                       const double *radius, const double *cell, int64_t *found) {
    return find_touching(pairs, shift, n, position, radius, cell, found);
}
