/* Makes system calls of the tested program fail (LD_PRELOAD), so no code path in the program can be missed.
 *
 * FAILING_UNDER   only files below this folder are affected
 * FAILING_CALL    read, open or stat
 * FAILING_FROM    index of the first failing call, from 0; none fails without it
 * FAILING_UNTIL   index of the first call that succeeds again; without it all later calls fail
 * FAILING_EVERY   every n-th call of that range fails
 * FAILING_BY      errno; 0 for reads of at most FAILING_SHORT bytes
 * FAILING_TOLD    output file: number of matching calls, and the file of the first failed one
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

static atomic_long calls;
static char failed[PATH_MAX];

static long number(const char *name, long otherwise) {
    const char *text = getenv(name);
    return text ? strtol(text, NULL, 10) : otherwise;
}

static int is_concerned(const char *call, const char *path) {
    const char *under = getenv("FAILING_UNDER");
    const char *which = getenv("FAILING_CALL");
    return under && which && !strcmp(which, call) && !strncmp(path, under, strlen(under));
}

/* Counts this call if it matches; true if it has to fail. */
static int fails_at(const char *call, const char *path) {
    if (!is_concerned(call, path)) return 0;
    long now = atomic_fetch_add(&calls, 1), from = number("FAILING_FROM", LONG_MAX);
    if (now == from) snprintf(failed, sizeof failed, "%s", path);
    return now >= from && now < number("FAILING_UNTIL", LONG_MAX)
        && (now - from) % number("FAILING_EVERY", 1) == 0;
}

static int open_file_fails(const char *call, int file) {
    char link[64], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    return fails_at(call, path);
}

static int named_file_fails(const char *call, const char *path) {
    char whole[2 * PATH_MAX], now[PATH_MAX];
    if (!path || !*path) return 0;
    if (*path == '/') return fails_at(call, path);
    if (!getcwd(now, sizeof now)) return 0;
    snprintf(whole, sizeof whole, "%s/%s", now, path);
    return fails_at(call, whole);
}

ssize_t read(int file, void *bytes, size_t most) {
    static ssize_t (*next)(int, void *, size_t);
    if (!next) next = dlsym(RTLD_NEXT, "read");
    if (open_file_fails("read", file)) {
        size_t shorter = number("FAILING_SHORT", 1);
        errno = number("FAILING_BY", EIO);
        if (errno) return -1;
        if (most > shorter) most = shorter;
    }
    return next(file, bytes, most);
}

int open64(const char *path, int flags, ...) {
    static int (*next)(const char *, int, ...);
    if (!next) next = dlsym(RTLD_NEXT, "open64");
    if (!(flags & O_CREAT) && named_file_fails("open", path)) {
        errno = number("FAILING_BY", EIO);
        return -1;
    }
    va_list rest;
    va_start(rest, flags);
    mode_t mode = flags & O_CREAT ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    return next(path, flags, mode);
}

int statx(int folder, const char *path, int flags, unsigned mask, struct statx *found) {
    static int (*next)(int, const char *, int, unsigned, struct statx *);
    if (!next) next = dlsym(RTLD_NEXT, "statx");
    if (folder == AT_FDCWD && named_file_fails("stat", path)) {
        errno = number("FAILING_BY", EIO);
        return -1;
    }
    return next(folder, path, flags, mask, found);
}

__attribute__((destructor)) static void tell(void) {
    const char *path = getenv("FAILING_TOLD");
    FILE *file = path ? fopen(path, "w") : NULL;
    if (file) {
        fprintf(file, "%ld\n%s\n", atomic_load(&calls), failed);
        fclose(file);
    }
}
