/* A file system without locks, for LD_PRELOAD: flock and the locks of fcntl fail with ENOLCK. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>

int flock(int fd, int operation) { errno = ENOLCK; return -1; }

static int locks(int command) {
    return command == F_SETLK || command == F_SETLKW || command == F_GETLK || command == F_OFD_SETLK || command == F_OFD_SETLKW;
}

#define REPLACED(name)                                                                   \
    int name(int fd, int command, ...) {                                                 \
        static int (*real)(int, int, ...);                                               \
        if (!real) real = dlsym(RTLD_NEXT, #name);                                       \
        va_list given;                                                                   \
        va_start(given, command);                                                        \
        void *argument = va_arg(given, void *);                                          \
        va_end(given);                                                                   \
        if (locks(command)) { errno = ENOLCK; return -1; }                               \
        return real(fd, command, argument);                                              \
    }

REPLACED(fcntl)
REPLACED(fcntl64)
