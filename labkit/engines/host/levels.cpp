// What does not depend on the level of instructions: which levels this processor has, and the layout as compiled.
#include "layout.hpp"
#include "stages.hpp"

#define EXPORT extern "C" __attribute__((visibility("default")))

// 4 or 3 for a processor with the instructions of x86-64-v4 or -v3, else 0.
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

// 1 if the compiler had OpenMP; otherwise the loop runs on one thread.
EXPORT int64_t several_threads() {
#ifdef _OPENMP
    return 1;
#else
    return 0;
#endif
}

// The numbers of layout.hpp, which labkit compares with its own.
EXPORT const int64_t compiled_layout[] = {
    WIDTH, LANES, PLACE_COLUMNS, SITE_W, SITE_COLUMNS, SITE_TORQUE, FORCE_COLUMNS, GRAIN_ROWS, MASS_ROWS, D, SQUARES, VREL,
    WA, WB, FORCE, TORQUE_A, TORQUE_B, CELL_WORK, SUM_ROWS, GRAIN_FORCE, GRAIN_TORQUE, W, WORK_ROWS, X, SPEED2,
    CONTACT_SUMS, DOUBLE_ROWS,
};

#ifdef TIME_STAGES
double stage_seconds[STAGES];  // of one thread
#endif
