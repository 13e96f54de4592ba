// The loop over time steps. It only moves data: every formula is in a function that labkit compiled from Python.
//
// Grains and contacts are divided into domains that do not depend on the number of threads, and every sum is taken in a
// fixed order, so results are bitwise identical for any number of threads. A domain contains consecutive grains in
// spatial order and the contacts whose first grain they are. If the second grain of a contact belongs to a different
// domain or period, the contact uses an image: a separate site that is copied from the grain after each motion. A
// contact therefore needs no periodic shift, and no two domains write to the same site.
#pragma once
#include <algorithm>
#include <vector>
#include "sites.hpp"
#include "stages.hpp"

namespace {  // of each level of instructions

using Table = void *const *;  // pointers to the arrays of a NamedTuple (labkit/engines/kernel/tables.py)

// The functions that labkit compiled from Python; see labkit/engines/kernel/blocks.py. Numba returns a null pointer from
// a function without a result, and WebAssembly compares the types of functions called by pointer.
template <class T> struct Functions {
    void *(*forces)(T *block, T *work, int64_t n, T dt, const T *numbers, const T *gradient);
    void *(*stress)(const T *block, const T *work, int64_t n, const T *numbers, double *sums);
    void *(*move)(double *block, const T *masses, T *work, double *doubles, int64_t n, double dt, Table motion,
                 double damping);
    void *(*start_step)(Table plan, int64_t row, Table motion, double dt);  // row of a new correction, or -1
    int64_t (*search_is_due)(Table motion, double dt, double speed2, double distance2);  // first with distance2 = -1
    double (*distance2)(const double *back, const double *places, const double *start, int64_t n);
    void *(*move_bodies)(Table bodies, Table arrays, int64_t domain, double dt, Table motion, double damping);
    void *(*place_members)(Table bodies, Table arrays, int64_t domain, Table motion);
    void *(*sum_forces)(Table bodies, Table arrays, int64_t domain, double dt, const T *gradient);
    void *(*fill_arms)(Table bodies, Table arrays);
};

// Data that stay the same between two neighbour searches.
template <class T> struct Loop {
    const Arrays<T> *arrays;
    Functions<T> call;
    Table motion;              // labkit.engines.kernel.motion.Motion
    const double *cell, *drift, *wanted, *back;  // arrays of motion
    double *totals;            // array of motion
    Table bodies;              // labkit.engines.kernel.bodies.Bodies, or null
    const T *arms;             // array of bodies: a record for each site, filled by fill_arms
    const T *numbers;          // parameters of the contact law
    T *gradient;               // `wanted` in the precision of contacts; null to omit the energy sums
    double damping;
    int64_t turning;           // 1 if the law needs velocities and produces torques
    int64_t radii;             // 1 if the stress depends on the radius of each grain
    int64_t first, last;       // domains of this rank
    double (*exchange)(int64_t what, double value, double *array, int64_t n);  // with other ranks; null on one rank
};

// What ranks exchange: images after the motion, forces on them before it, the largest `value`, the sums in `array`.
enum Exchange { PLACES, FORCES, LARGEST, SUMS };

inline int whole_lanes(int64_t n) { return int((std::min<int64_t>(WIDTH, n) + LANES - 1) / LANES * LANES); }

template <class T> void prefetch(const T *block, int64_t first, int64_t last) {
    for (int64_t i = first; i < last; i += 64 / sizeof(T)) __builtin_prefetch(block + i, 1);
}

template <class T> void domain_contacts(const Loop<T> &loop, int64_t domain, T dt) {
    const Arrays<T> &s = *loop.arrays;
    T *work = s.workspace(domain);
    const int64_t last = s.contact_last[domain], size = s.sizes->block_size;
    for (int64_t start = s.contact_first[domain]; start < last; start += WIDTH) {
        const int n = whole_lanes(last - start);
        T *block = s.blocks + start / WIDTH * size;
        prefetch(block + size, 0, size / 2);  // the next block, in two halves so that requests do not queue
        const uint32_t *a = s.pairs + start, *b = s.pairs + s.sizes->slots + start;
        TIMED(READ, read_branches(s.places, a, b, work + D, n); read_motions(s.motions, a, b, work, n, loop.turning));
        TIMED(LAW, loop.call.forces(block, work, n, dt, loop.numbers, loop.gradient));
        prefetch(block + size, size / 2, size);
        TIMED(ADD, add_to_sites(s.forces, a, b, work, n, loop.turning));
    }
    if (sizeof(T) < sizeof(double) && loop.gradient) {
        double *sums = s.double_workspace(domain) + CONTACT_SUMS;
        for (int k = 0; k < SUM_ROWS * WIDTH; k++) sums[k] += work[CELL_WORK + k], work[CELL_WORK + k] = 0;
    }
}

// Move the grains of a domain and update their sites.
template <class T> void domain_grains(const Loop<T> &loop, int64_t domain, double dt) {
    constexpr int N = PER_ROW<T>;
    const Arrays<T> &s = *loop.arrays;
    T *work = s.workspace(domain);
    double *doubles = s.double_workspace(domain);
    const int64_t last = s.grain_first[domain + 1];
    for (int64_t start = s.grain_first[domain]; start < last; start += WIDTH) {
        const int64_t n = std::min<int64_t>(WIDTH, last - start);
        double *block = s.grains + start / WIDTH * GRAIN_ROWS * WIDTH, *places = s.places + PLACE_COLUMNS * start;
        T *motions = s.motions + SITE_COLUMNS * start, *forces = s.forces + FORCE_COLUMNS * start;
        for (int64_t i = 0; i < n; i += 4) {
            Record<double> x[4];
            for (int k = 0; k < 4; k++) x[k] = record(places + PLACE_COLUMNS * (i + k));
            to_rows<double>(x, doubles + X + i);
        }
        for (int64_t i = 0; i < n; i += N) {
            Record<T> force[N], torque[N], spin[N];
            for (int k = 0; k < N; k++) {
                T *of_site = forces + FORCE_COLUMNS * (i + k);
                force[k] = record(of_site), torque[k] = record(of_site + SITE_TORQUE);
                spin[k] = record(motions + SITE_COLUMNS * (i + k) + SITE_W);
                record(of_site) = record(of_site + SITE_TORQUE) = Record<T>{};
            }
            to_rows<T>(force, work + GRAIN_FORCE + i, 3), to_rows<T>(torque, work + GRAIN_TORQUE + i, 3);
            to_rows<T>(spin, work + W + i);
        }
        const T *masses = s.masses + start / WIDTH * MASS_ROWS * WIDTH;
        loop.call.move(block, masses, work, doubles, n, dt, loop.motion, loop.damping);
        for (int64_t i = 0; i < n; i += 4) {
            Record<double> x[4], v[4];
            to_records<double>(doubles + X + i, x), to_records<double>(block + i, v, 3);
            for (int k = 0; k < 4; k++) {
                record(places + PLACE_COLUMNS * (i + k)) = x[k];
                record(motions + SITE_COLUMNS * (i + k)) = CONVERT(v[k], Record<T>);
            }
        }
        for (int64_t i = 0; i < n; i += N) {
            Record<T> spin[N];
            to_records<T>(work + W + i, spin);
            for (int k = 0; k < N; k++) record(motions + SITE_COLUMNS * (i + k) + SITE_W) = spin[k];
        }
    }
}

// Return the largest number in the row SPEED2 of a domain, and clear the row.
inline double largest_speed2(double *doubles) {
    double largest = 0;
    for (int i = 0; i < WIDTH; i++) largest = std::max(largest, doubles[SPEED2 + i]), doubles[SPEED2 + i] = 0;
    return largest;
}

// Add branch (x) force of the contacts of a domain to `sums` (9, WIDTH); the function `stress` computes the force.
template <class T> void domain_stress(const Loop<T> &loop, int64_t domain, double *sums) {
    const Arrays<T> &s = *loop.arrays;
    T *work = s.workspace(domain);
    for (int64_t start = s.contact_first[domain]; start < s.contact_last[domain]; start += WIDTH) {
        const int64_t left = s.contact_last[domain] - start;
        const int n = whole_lanes(left);
        const uint32_t *a = s.pairs + start, *b = s.pairs + s.sizes->slots + start;
        read_branches(s.places, a, b, work + D, n);
        if (loop.bodies) read_motions(loop.arms, a, b, work, n, true);  // writes differences of arms to the rows VREL
        if (loop.radii) read_motions(s.motions, a, b, work, n, false);
        T *block = s.blocks + start / WIDTH * s.sizes->block_size;
        loop.call.stress(block, work, std::min<int64_t>(WIDTH, left), loop.numbers, sums);
    }
}

// Set `totals` (9,) to the sums of branch (x) force over all contacts. All threads of a team call it together.
template <class T> void branch_force(const Loop<T> &loop, std::vector<double> &sums) {
    const int64_t domains = loop.arrays->sizes->domains;
    #pragma omp single
    {
        sums.assign(domains * 9 * WIDTH, 0);
        if (loop.bodies) loop.call.fill_arms(loop.bodies, reinterpret_cast<Table>(loop.arrays));
    }
    #pragma omp for schedule(static)
    for (int64_t d = loop.first; d < loop.last; d++) domain_stress(loop, d, sums.data() + d * 9 * WIDTH);
    #pragma omp single
    {
        if (loop.exchange) loop.exchange(SUMS, 0, sums.data(), int64_t(sums.size()));
        for (int k = 0; k < 9; k++) {
            loop.totals[k] = 0;
            for (int64_t d = 0; d < domains; d++)
                for (int i = 0; i < WIDTH; i++) loop.totals[k] += sums[(9 * d + k) * WIDTH + i];
        }
    }
}

// The corrections of the servo: each is a velocity gradient for a number of time steps.
struct Plan {
    Table table;           // labkit.servo.formula.ServoPlan
    const int64_t *steps;  // time steps of each row
    int64_t *place;        // next row, and time steps until the next correction
    int64_t controlled;    // 1 if stresses are held
};

// Run up to `steps` time steps of dt, s, and return the number completed. `search` becomes true if a neighbour search
// is needed: the grains have then already been moved for the next step, but the forces of that step have not been
// computed. Run the search, then call again with `moved`.
template <class T>
int64_t advance(const Loop<T> &loop, const Plan &plan, int64_t steps, bool moved, double dt, int threads, bool *search) {
    const Arrays<T> &s = *loop.arrays;
    const Functions<T> &call = loop.call;
    const Table table = reinterpret_cast<Table>(&s);
    const int64_t domains = s.sizes->domains;
    std::vector<double> largest(domains), sums(plan.controlled ? domains * 9 * WIDTH : 0);  // no thread may allocate
    int64_t done = steps;
    bool started = false, measure = false, due = false;
    bool corrects[2] = {plan.place[1] == 0, plan.place[1] == 0};  // at even and odd steps: no thread is two steps behind
    auto copy_gradient = [&] { for (int k = 0; k < 9 && loop.gradient; k++) loop.gradient[k] = T(loop.wanted[k]); };
    auto start = [&](int64_t step) {  // called by one thread
        const bool now = corrects[step % 2];
        call.start_step(plan.table, now ? plan.place[0] : -1, loop.motion, dt);
        if (now) plan.place[1] = plan.steps[plan.place[0]++], copy_gradient();
        corrects[(step + 1) % 2] = --plan.place[1] == 0;
    };
    auto largest_of_all = [&] {
        const double value = *std::max_element(largest.begin(), largest.end());
        return loop.exchange ? loop.exchange(LARGEST, value, nullptr, 0) : value;
    };
    copy_gradient();
    #pragma omp parallel num_threads(threads) if (threads > 1)
    for (int64_t step = 0; step < steps; step++) {
        if (!(moved && step == 0)) {
            if (!started) {
                if (corrects[step % 2] && plan.controlled) branch_force(loop, sums);
                #pragma omp single
                start(step);
            }
            if (loop.bodies) {
                #pragma omp for schedule(static)
                for (int64_t d = 0; d < domains; d++) call.move_bodies(loop.bodies, table, d, dt, loop.motion, loop.damping);
            }
            if (loop.exchange) {
                #pragma omp single
                loop.exchange(FORCES, 0, nullptr, 0);
            }
            #pragma omp for schedule(static)
            for (int64_t d = loop.first; d < loop.last; d++) {
                TIMED(IMAGES, collect_images(s, d));
                TIMED(MOVE, domain_grains(loop, d, dt));
                if (loop.bodies) call.place_members(loop.bodies, table, d, loop.motion);
                TIMED(IMAGES, place_images(s, d, loop.cell, loop.drift));
                largest[d] = largest_speed2(s.double_workspace(d));
            }
            #pragma omp single
            {
                const double fastest = largest_of_all();  // ranks wait here for each other
                if (loop.exchange) loop.exchange(PLACES, 0, nullptr, 0);
                measure = call.search_is_due(loop.motion, dt, fastest, -1);
                // the next step can start before the contacts of this one, unless a correction needs their stress
                started = !measure && step + 1 < steps && !corrects[(step + 1) % 2];
                if (started) start(step + 1);
            }
            if (measure) {
                #pragma omp for schedule(static)
                for (int64_t d = loop.first; d < loop.last; d++) {
                    const int64_t first = s.grain_first[d], n = s.grain_first[d + 1] - first;
                    largest[d] = call.distance2(loop.back, s.places + PLACE_COLUMNS * first, s.start + 3 * first, n);
                }
                #pragma omp single
                {
                    due = call.search_is_due(loop.motion, dt, 0, largest_of_all());
                    if (due) done = step;
                }
                if (due) break;
            }
        }
        #pragma omp for schedule(static)
        for (int64_t d = loop.first; d < loop.last; d++) domain_contacts(loop, d, T(dt));
        if (loop.bodies) {
            #pragma omp for schedule(static)
            for (int64_t d = 0; d < domains; d++) collect_images(s, d);
            #pragma omp for schedule(static)
            for (int64_t d = 0; d < domains; d++) call.sum_forces(loop.bodies, table, d, dt, loop.gradient);
        }
    }
    *search = due;
    return done;
}

}  // namespace
