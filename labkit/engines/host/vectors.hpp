// Vectors of numbers that the processor handles at once, and the conversion between records and rows.
//
// A site stores a three-component vector as a Record of four numbers; blocks store one quantity per row. A Row is a
// part of such a row: four double or eight single numbers.
#pragma once
#include <cmath>
#include <type_traits>
#include "layout.hpp"

namespace {  // of each level of instructions

// a b + c of numbers or vectors, rounded once if the processor supports it, as in the functions compiled from Python
template <class V> inline V fused(V a, V b, V c) {
    if constexpr (std::is_arithmetic_v<V>) {
#ifdef FP_FAST_FMA
        return std::fma(a, b, c);
#else
        return a * b + c;
#endif
    } else {
        for (unsigned k = 0; k < sizeof(V) / sizeof(a[0]); k++) c[k] = fused(a[k], b[k], c[k]);
        return c;
    }
}

#if defined(__clang__) || defined(__AVX__)
template <class T, int N> struct VectorOf { typedef T Type __attribute__((vector_size(N * sizeof(T)))); };
#define CONVERT(vector, Type) __builtin_convertvector(vector, Type)
#else  // GCC would keep vectors that are wider than a register in memory, which takes four times as long
template <class T, int N> struct __attribute__((may_alias)) Numbers {
    T number[N];
    T &operator[](int k) { return number[k]; }
    T operator[](int k) const { return number[k]; }
    template <class F> static Numbers of(F value) {
        Numbers r;
        for (int k = 0; k < N; k++) r[k] = value(k);
        return r;
    }
    friend Numbers operator+(Numbers a, Numbers b) { return of([&](int k) { return a[k] + b[k]; }); }
    friend Numbers operator-(Numbers a, Numbers b) { return of([&](int k) { return a[k] - b[k]; }); }
    friend Numbers operator*(Numbers a, Numbers b) { return of([&](int k) { return a[k] * b[k]; }); }
    friend Numbers operator+(Numbers a, T b) { return of([&](int k) { return a[k] + b; }); }
    friend Numbers operator-(Numbers a) { return of([&](int k) { return -a[k]; }); }
    Numbers &operator+=(Numbers b) { return *this = *this + b; }
    Numbers &operator-=(Numbers b) { return *this = *this - b; }
};
template <class T, int N> struct VectorOf { using Type = Numbers<T, N>; };
#define CONVERT(vector, Type) Type::of([&](int place) { return (vector)[place]; })
#endif
template <class T> using Record = typename VectorOf<T, 4>::Type;
template <class T> constexpr int PER_ROW = 32 / sizeof(T);  // numbers in a Row
template <class T> using Row = typename VectorOf<T, PER_ROW<T>>::Type;

template <class T> inline Record<T> &record(T *numbers) { return *reinterpret_cast<Record<T> *>(numbers); }
template <class T> inline const Record<T> &record(const T *numbers) { return *reinterpret_cast<const Record<T> *>(numbers); }
template <class T> inline Row<T> &row(T *numbers) { return *reinterpret_cast<Row<T> *>(numbers); }

#if (defined(__clang__) || defined(__AVX__)) && defined(__has_builtin)
#if __has_builtin(__builtin_shufflevector)
#define SHUFFLES
#endif
#endif

// Transpose 4 x 4 numbers, in each group of four numbers of the four vectors.
template <class V> inline void exchange(V *r) {
    constexpr int count = sizeof(V) / sizeof(r[0][0]);
#ifdef SHUFFLES
    if constexpr (count == 4) {
        const V a = __builtin_shufflevector(r[0], r[1], 0, 4, 2, 6), b = __builtin_shufflevector(r[0], r[1], 1, 5, 3, 7);
        const V c = __builtin_shufflevector(r[2], r[3], 0, 4, 2, 6), d = __builtin_shufflevector(r[2], r[3], 1, 5, 3, 7);
        r[0] = __builtin_shufflevector(a, c, 0, 1, 4, 5), r[1] = __builtin_shufflevector(b, d, 0, 1, 4, 5);
        r[2] = __builtin_shufflevector(a, c, 2, 3, 6, 7), r[3] = __builtin_shufflevector(b, d, 2, 3, 6, 7);
    } else {
        const V a = __builtin_shufflevector(r[0], r[1], 0, 8, 1, 9, 4, 12, 5, 13);
        const V b = __builtin_shufflevector(r[0], r[1], 2, 10, 3, 11, 6, 14, 7, 15);
        const V c = __builtin_shufflevector(r[2], r[3], 0, 8, 1, 9, 4, 12, 5, 13);
        const V d = __builtin_shufflevector(r[2], r[3], 2, 10, 3, 11, 6, 14, 7, 15);
        r[0] = __builtin_shufflevector(a, c, 0, 1, 8, 9, 4, 5, 12, 13);
        r[1] = __builtin_shufflevector(a, c, 2, 3, 10, 11, 6, 7, 14, 15);
        r[2] = __builtin_shufflevector(b, d, 0, 1, 8, 9, 4, 5, 12, 13);
        r[3] = __builtin_shufflevector(b, d, 2, 3, 10, 11, 6, 7, 14, 15);
    }
#else
    for (int group = 0; group < count; group += 4)
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < i; j++) {
                const auto kept = r[i][group + j];
                r[i][group + j] = r[j][group + i], r[j][group + i] = kept;
            }
#endif
}

// Join record k with record k + 4, and the inverse; a Row of doubles is one record.
inline Row<double> join(const Record<double> *records, int k) { return records[k]; }
inline void split(Row<double> joint, Record<double> *records, int k) { records[k] = joint; }
inline Row<float> join(Record<float> a, Record<float> b) {
#ifdef SHUFFLES
    return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
#else
    return Row<float>{a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]};
#endif
}
inline Row<float> join(const Record<float> *records, int k) { return join(records[k], records[k + 4]); }
inline void split(Row<float> joint, Record<float> *records, int k) {
#ifdef SHUFFLES
    records[k] = __builtin_shufflevector(joint, joint, 0, 1, 2, 3), records[k + 4] = __builtin_shufflevector(joint, joint, 4, 5, 6, 7);
#else
    for (int i = 0; i < 4; i++) records[k][i] = joint[i], records[k + 4][i] = joint[4 + i];
#endif
}

// Write PER_ROW records to the first `count` of four rows, `rows` apart by WIDTH.
template <class T> inline void to_rows(const Record<T> *records, T *rows, int count = 4) {
#ifdef SHUFFLES
    Row<T> r[4];
    for (int k = 0; k < 4; k++) r[k] = join(records, k);
    exchange(r);
    for (int k = 0; k < count; k++) row(rows + k * WIDTH) = r[k];
#else
    for (int k = 0; k < count; k++)
        for (int i = 0; i < PER_ROW<T>; i++) rows[k * WIDTH + i] = records[i][k];
#endif
}

// Read PER_ROW records from `count` rows; with three rows, the last number of each record is 0.
template <class T> inline void to_records(T *rows, Record<T> *records, int count = 4) {
#ifdef SHUFFLES
    Row<T> r[4] = {};
    for (int k = 0; k < count; k++) r[k] = row(rows + k * WIDTH);
    exchange(r);
    for (int k = 0; k < 4; k++) split(r[k], records, k);
#else
    for (int i = 0; i < PER_ROW<T>; i++)
        for (int k = 0; k < 4; k++) records[i][k] = k < count ? rows[k * WIDTH + i] : 0;
#endif
}

}  // namespace
