// Sites, one per grain or image: contacts read place and motion from sites and add forces to sites.
#pragma once
#include "vectors.hpp"

namespace {  // of each level of instructions

// Write the branches of n pairs and the sums of their radii to the four rows that start at `rows`. In single precision,
// a fifth row gets R^2 - d^2, computed in double precision from the sum R of the radii and the branch d.
template <class T> void read_branches(const double *places, const uint32_t *a, const uint32_t *b, T *rows, int n) {
    constexpr int N = PER_ROW<T>;
    const Record<double> signs = {-1, -1, -1, 1};
    for (int i = 0; i < n; i += N) {
        Record<double> branch[N];
        for (int k = 0; k < N; k++) {
            const Record<double> first = record(places + PLACE_COLUMNS * size_t(a[i + k]));
            branch[k] = first * signs + record(places + PLACE_COLUMNS * size_t(b[i + k]));
        }
        if constexpr (sizeof(T) == sizeof(double)) to_rows<T>(branch, rows + i);
        else for (int half = 0; half < N; half += 4) {
            Record<double> *r = branch + half, squares;
            exchange(r);
            squares = r[3] * r[3];
            for (int k = 0; k < 3; k++) squares = fused(-r[k], r[k], squares);
            for (int k = 0; k < 4; k++) record(rows + k * WIDTH + i + half) = CONVERT(r[k], Record<T>);
            record(rows + SQUARES - D + i + half) = CONVERT(squares, Record<T>);
        }
    }
}

// Read spins and radii of n pairs and, with `velocities`, the velocity of the second grain relative to the first.
template <class T>
void read_motions(const T *motions, const uint32_t *a, const uint32_t *b, T *work, int n, bool velocities) {
    constexpr int N = PER_ROW<T>;
    for (int i = 0; i < n; i += N) {
        Record<T> v[N], wa[N], wb[N];
        for (int k = 0; k < N; k++) {
            const T *first = motions + SITE_COLUMNS * size_t(a[i + k]), *second = motions + SITE_COLUMNS * size_t(b[i + k]);
            v[k] = record(second) - record(first);
            wa[k] = record(first + SITE_W), wb[k] = record(second + SITE_W);
        }
        if (velocities) to_rows<T>(v, work + VREL + i, 3);
        to_rows<T>(wa, work + WA + i), to_rows<T>(wb, work + WB + i);
    }
}

// Add forces and torques of n contacts to the sites of their grains, one contact after another; the force on the second
// grain is opposite. In double precision, groups of eight forces, eight torques on first grains and eight torques on
// second grains alternate.
template <class T>
void add_to_sites(T *forces, const uint32_t *a, const uint32_t *b, T *work, int n, bool torques) {
    for (int i = 0; i < n; i += 8) {
        Record<T> f[8], turn_a[8] = {}, turn_b[8] = {};
        for (int part = 0; part < 8; part += PER_ROW<T>) {
            to_records<T>(work + FORCE + i + part, f + part, 3);
            if (!torques) continue;
            to_records<T>(work + TORQUE_A + i + part, turn_a + part, 3);
            to_records<T>(work + TORQUE_B + i + part, turn_b + part, 3);
        }
        if constexpr (sizeof(T) == sizeof(double)) {
            for (int k = 0; k < 8; k++) {
                record(forces + FORCE_COLUMNS * size_t(a[i + k])) += f[k];
                record(forces + FORCE_COLUMNS * size_t(b[i + k])) -= f[k];
            }
            for (int k = 0; k < 8 && torques; k++) record(forces + FORCE_COLUMNS * size_t(a[i + k]) + SITE_TORQUE) += turn_a[k];
            for (int k = 0; k < 8 && torques; k++) record(forces + FORCE_COLUMNS * size_t(b[i + k]) + SITE_TORQUE) += turn_b[k];
        } else for (int k = 0; k < 8; k++) {  // force and torque of a site are one vector
            row(forces + FORCE_COLUMNS * size_t(a[i + k])) += join(f[k], turn_a[k]);
            row(forces + FORCE_COLUMNS * size_t(b[i + k])) += join(-f[k], turn_b[k]);
        }
    }
}

// Add the forces on the images of a domain to the grains of which they are copies, and clear these forces.
template <class T> void collect_images(const Arrays<T> &s, int64_t domain) {
    T *images = s.forces + FORCE_COLUMNS * s.first_image();
    for (int64_t i = s.image_first[domain]; i < s.image_first[domain + 1]; i++) {
        T *to = s.forces + FORCE_COLUMNS * s.owner[i], *from = images + FORCE_COLUMNS * i;
        for (int k = 0; k < FORCE_COLUMNS; k += PER_ROW<T>) row(to + k) += row(from + k), row(from + k) = Row<T>{};
    }
}

// Return the sum of the records `periods`, each multiplied by its component of `shift`.
template <class T> inline Record<T> periods_away(const double *shift, const Record<T> *periods) {
    auto times = [&](int k) { return Record<T>{} + T(shift[k]); };
    return fused(times(2), periods[2], fused(times(0), periods[0], times(1) * periods[1]));
}

// Copy the grains of a domain to their images; a period adds a column of `cell` to the place and of `drift` to the
// velocity, both (3, 3).
template <class T> void place_images(const Arrays<T> &s, int64_t domain, const double *cell, const double *drift) {
    Record<double> vectors[3];
    Record<T> drifts[3];
    for (int k = 0; k < 3; k++) {
        vectors[k] = Record<double>{cell[k], cell[3 + k], cell[6 + k], 0};
        drifts[k] = Record<T>{T(drift[k]), T(drift[3 + k]), T(drift[6 + k]), 0};
    }
    for (int64_t i = s.image_first[domain]; i < s.image_first[domain + 1]; i++) {
        const int64_t owner = s.owner[i], image = s.first_image() + i;
        T *from = s.motions + SITE_COLUMNS * owner, *to = s.motions + SITE_COLUMNS * image;
        record(s.places + PLACE_COLUMNS * image) = record(s.places + PLACE_COLUMNS * owner) + periods_away<double>(s.shift + 3 * i, vectors);
        record(to) = record(from) + periods_away<T>(s.shift + 3 * i, drifts);
        record(to + SITE_W) = record(from + SITE_W);
    }
}

}  // namespace
