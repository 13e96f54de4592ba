/* A clock for LD_PRELOAD: CLOCK_ADD s are added to the date; the monotonic clock goes back by CLOCK_BACK s as soon as the
 * file CLOCK_FILE exists, as on a virtual machine that is restored. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t clock, struct timespec *now) {
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = dlsym(RTLD_NEXT, "clock_gettime");
    int result = real(clock, now);
    const char *add = getenv("CLOCK_ADD"), *back = getenv("CLOCK_BACK"), *file = getenv("CLOCK_FILE");
    if (clock == CLOCK_REALTIME && add) now->tv_sec += atol(add);
    if (clock == CLOCK_MONOTONIC && back && file && access(file, F_OK) == 0) now->tv_sec -= atol(back);
    return result;
}
