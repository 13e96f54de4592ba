// Functions that are the same for all levels of instructions: the level of this processor, and the compiled layout.
#include <cstddef>
#include <exception>
#ifndef __wasm__
#include <mutex>
#include <thread>
#endif
#include <vector>
#include "layout.hpp"
#include "loop.hpp"
#include "stages.hpp"

#define EXPORT extern "C" __attribute__((visibility("default")))

// Return 4 or 3 for a processor with the instructions of x86-64-v4 or -v3, otherwise 0.
EXPORT int64_t processor_level() {
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (!(__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2"))) return 0;
    const bool v4 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512cd")
                    && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
    return v4 ? 4 : 3;
#else
    return 0;
#endif
}

// Return 1 if the library was compiled with OpenMP; otherwise the loop runs on one thread.
EXPORT int64_t several_threads() {
#ifdef _OPENMP
    return 1;
#else
    return 0;
#endif
}

// Return 1 if the system starts so many threads; otherwise OpenMP would end the process when it starts them.
EXPORT int64_t can_start(int64_t threads) {
#ifdef __wasm__
    return threads == 1;
#else
    std::mutex wait;
    std::vector<std::thread> started;
    bool all = true;
    wait.lock();
    try {
        while (int64_t(started.size()) < threads - 1) started.emplace_back([&] { std::lock_guard<std::mutex> end(wait); });
    } catch (const std::exception &) {
        all = false;
    }
    wait.unlock();
    for (std::thread &one : started) one.join();
    return all;
#endif
}

// The numbers of layout.hpp; labkit compares them with the numbers in labkit/engines/kernel/layout.py.
EXPORT const int64_t compiled_layout[] = {
    WIDTH, LANES, PLACE_COLUMNS, SITE_W, SITE_COLUMNS, SITE_TORQUE, FORCE_COLUMNS, GRAIN_ROWS, MASS_ROWS, D, SQUARES, VREL,
    WA, WB, FORCE, TORQUE_A, TORQUE_B, CELL_WORK, SUM_ROWS, GRAIN_FORCE, GRAIN_TORQUE, W, WORK_ROWS, X, SPEED2,
    CONTACT_SUMS, DOUBLE_ROWS,
};

// Size, and offset of each member, of the structs that labkit fills (labkit/engines/kernel/layout.py).
using L = Loop<double>;
EXPORT const int64_t compiled_loop[] = {
    sizeof(L), offsetof(L, arrays), offsetof(L, call), offsetof(L, motion), offsetof(L, cell), offsetof(L, drift),
    offsetof(L, wanted), offsetof(L, back), offsetof(L, totals), offsetof(L, bodies), offsetof(L, arms), offsetof(L, numbers),
    offsetof(L, gradient), offsetof(L, damping), offsetof(L, turning), offsetof(L, radii), offsetof(L, first),
    offsetof(L, last), offsetof(L, exchange),
};
using A = Arrays<double>;
EXPORT const int64_t compiled_arrays[] = {
    sizeof(A), offsetof(A, grain_first), offsetof(A, contact_first), offsetof(A, contact_last), offsetof(A, places),
    offsetof(A, motions), offsetof(A, forces), offsetof(A, grains), offsetof(A, masses), offsetof(A, image_first),
    offsetof(A, owner), offsetof(A, shift), offsetof(A, pairs), offsetof(A, blocks), offsetof(A, work),
    offsetof(A, doubles), offsetof(A, start), offsetof(A, sizes),
};
EXPORT const int64_t compiled_plan[] = {
    sizeof(Plan), offsetof(Plan, table), offsetof(Plan, steps), offsetof(Plan, place), offsetof(Plan, controlled),
};
static_assert(sizeof(Loop<float>) == sizeof(L) && sizeof(Functions<double>) == 10 * sizeof(void *), "pointers have one size");

#ifdef TIME_STAGES
double stage_seconds[STAGES];  // time of each stage on one thread
#endif
