/* A file layer that fails at the n-th call, for LD_PRELOAD: write, pwrite, posix_fallocate and fsync of regular files.
 *
 * arm(n, kind): the n-th call from now on fails. kind: an errno, such as ENOSPC or EIO; 0 for a short write, of half of
 * the bytes, after which the disk is full. A full disk lets bytes be written again that the file has already.
 * calls(): number of calls since then. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <sys/stat.h>
#include <unistd.h>

static long left = -1, made = 0;
static int error_number = 0;
static int full = 0;

void arm(long n, int kind) { left = n; error_number = kind; made = 0; full = 0; }
long calls(void) { return made; }

static int regular(int fd) {
    struct stat info;
    return fstat(fd, &info) == 0 && S_ISREG(info.st_mode);
}

/* 0: go on; 1: fail with errno; 2: write half */
static int fails(int fd) {
    if (left < 0 || !regular(fd)) return 0;
    made++;
    if (full) { errno = ENOSPC; return 1; }
    if (made != left) return 0;
    if (error_number == 0) { full = 1; return 2; }
    if (error_number == ENOSPC) full = 1;
    errno = error_number;
    return 1;
}

ssize_t write(int fd, const void *data, size_t size) {
    static ssize_t (*real)(int, const void *, size_t);
    if (!real) real = dlsym(RTLD_NEXT, "write");
    int how = fails(fd);
    return how == 1 ? -1 : real(fd, data, how == 2 ? size / 2 : size);
}

ssize_t pwrite(int fd, const void *data, size_t size, off_t at) {
    static ssize_t (*real)(int, const void *, size_t, off_t);
    if (!real) real = dlsym(RTLD_NEXT, "pwrite");
    struct stat info;
    if (error_number != EIO && fstat(fd, &info) == 0 && at + (off_t)size <= info.st_size) return real(fd, data, size, at);
    int how = fails(fd);
    return how == 1 ? -1 : real(fd, data, how == 2 ? size / 2 : size, at);
}

ssize_t pwrite64(int fd, const void *data, size_t size, off_t at) { return pwrite(fd, data, size, at); }

int posix_fallocate(int fd, off_t at, off_t size) {
    static int (*real)(int, off_t, off_t);
    if (!real) real = dlsym(RTLD_NEXT, "posix_fallocate");
    return fails(fd) ? (error_number ? error_number : ENOSPC) : real(fd, at, size);
}

int posix_fallocate64(int fd, off_t at, off_t size) { return posix_fallocate(fd, at, size); }

int fsync(int fd) {
    static int (*real)(int);
    if (!real) real = dlsym(RTLD_NEXT, "fsync");
    return fails(fd) ? -1 : real(fd);
}
