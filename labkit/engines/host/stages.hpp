// Measures the time of each stage of a step for benchmarks/stages.py, which compiles the host with TIME_STAGES.
#pragma once

enum Stage { READ, LAW, ADD, MOVE, IMAGES, STAGES };

#ifdef TIME_STAGES
#include <chrono>
extern "C" __attribute__((visibility("default"))) double stage_seconds[STAGES];
namespace {
struct Stopwatch {
    Stage stage;
    std::chrono::steady_clock::time_point begin = std::chrono::steady_clock::now();
    ~Stopwatch() { stage_seconds[stage] += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count(); }
};
}  // namespace
#define TIMED(stage, ...) do { Stopwatch stopwatch{stage}; __VA_ARGS__; } while (false)
#else
#define TIMED(stage, ...) do { __VA_ARGS__; } while (false)
#endif
