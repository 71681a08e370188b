// Counts the calls that change files below FAULT_ROOT, in all threads of a process, and lets one of them go wrong.
// Loaded before the C library by LD_PRELOAD; Linux only.
//
//   FAULT_ROOT  absolute path of the folder that is looked at
//   FAULT_AT    number of the call that goes wrong, from 1
//   FAULT_KIND  how: "kill" (SIGKILL before it is done), "half" (SIGKILL, after half of the bytes if it writes),
//               "full" (no space left for this one and all that follow and need some), "error" (an I/O error),
//               "interrupt" (by a signal: to be tried again), "short" (half of the bytes are written, if it writes)
//   FAULT_HIDE  seconds for which new names in folders of stages are not seen, as on a network disk; for as long again they
//               have an old size
//   FAULT_LOG   file to which every call is appended once it succeeded, with its bytes: what power_cuts.py makes the
//               contents of a disk from. One line "number operation path offset rest", with tabs between; the rest is
//               how many bytes were written, which follow the line, or the new path.
//
// One lock is held during each call, so the log has the order in which the system saw them.

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static long calls;

static const char *setting(const char *name) {
    const char *value = getenv(name);
    return value ? value : "";
}

// The next definition of a function: the C library's.
#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

static int below_root(const char *path) {
    const char *root = setting("FAULT_ROOT");
    size_t length = strlen(root);
    return length && !strncmp(path, root, length) && (path[length] == '/' || !path[length]);
}

// Whether a descriptor's file lies below the root and still has a name, which is put into `path`.
static int named(int fd, char path[PATH_MAX]) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, PATH_MAX - 1);
    if (length < 0) return 0;
    path[length] = 0;
    return below_root(path) && access(path, F_OK) == 0;
}

// A path as the process named it, from its root.
static int absolute(int folder, const char *name, char path[PATH_MAX]) {
    char base[PATH_MAX] = "";
    if (name[0] != '/') {
        char link[64] = "/proc/self/cwd";
        if (folder != AT_FDCWD) snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
        ssize_t length = readlink(link, base, PATH_MAX - 2);
        if (length < 0) return 0;
        base[length] = '/';
        base[length + 1] = 0;
    }
    if (snprintf(path, PATH_MAX, "%s%s", base, name) >= PATH_MAX) return 0;
    return below_root(path);
}

// Seconds since a name in the folder of a stage appeared, but for the stage's own file; large for all others.
static double age(int folder, const char *name) {
    char path[PATH_MAX];
    struct stat64 found;
    struct timespec now;
    const char *stage;
    if (!*setting("FAULT_HIDE") || !absolute(folder, name, path) || !(stage = strstr(path, "/stage-"))) return 1e9;
    const char *file = strchr(stage + 1, '/');
    if (!file || !strncmp(file, "/stage.bin", 10) || fstatat64(AT_FDCWD, path, &found, AT_SYMLINK_NOFOLLOW)) return 1e9;
    clock_gettime(CLOCK_REALTIME, &now);
    return (now.tv_sec - found.st_ctim.tv_sec) + 1e-9 * (now.tv_nsec - found.st_ctim.tv_nsec);
}

static void die(void) {
    kill(getpid(), SIGKILL);
    for (;;) pause();
}

enum need { NOTHING, SPACE, TO_BE_TRIED_AGAIN, BOTH };

// Takes the lock and counts a call; the number of the error that it fails with, or 0. `*length` becomes the bytes of a
// short write.
static int enter(enum need need, size_t *length, int *dies) {
    const char *kind = setting("FAULT_KIND");
    long at = atol(setting("FAULT_AT"));
    pthread_mutex_lock(&lock);
    calls++;
    if (!at || calls < at) return 0;
    if (!strcmp(kind, "full")) return need & SPACE ? ENOSPC : 0;
    if (calls > at) return 0;
    if (!strcmp(kind, "error")) return EIO;
    if (!strcmp(kind, "interrupt")) return need & TO_BE_TRIED_AGAIN ? EINTR : 0;
    if (!strcmp(kind, "kill")) die();
    if (!strcmp(kind, "half")) {
        if (!length) die();
        *dies = 1;
    }
    if (length && *length > 1) *length /= 2;
    return 0;
}

static int fail(int error) {
    pthread_mutex_unlock(&lock);
    errno = error;
    return -1;
}

// For calls that do not write.
#define ENTER(need)                                   \
    int error_ = enter(need, NULL, NULL);              \
    if (error_) return fail(error_)

static void put(const void *bytes, size_t length) {
    static int log = -2;
    if (log == -2) log = REAL(open)(setting("FAULT_LOG"), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    if (log < 0) die();
    for (ssize_t done; length; bytes = (const char *)bytes + done, length -= done)
        if ((done = REAL(write)(log, bytes, length)) < 0) die();
}

// Records a call that succeeded, and lets the next one begin.
static void leave(int succeeded, const char *operation, const char *path, long long offset, const char *rest,
                  const void *bytes, size_t length) {
    int error = errno;
    if (succeeded && *setting("FAULT_LOG")) {
        char line[2 * PATH_MAX + 128];
        put(line, snprintf(line, sizeof line, "%ld\t%s\t%s\t%lld\t%s\n", calls, operation, path, offset, rest));
        put(bytes, length);
    }
    pthread_mutex_unlock(&lock);
    errno = error;
}

static void leave_write(int fd, ssize_t done, const char *path, long long offset, const void *bytes) {
    char count[32];
    snprintf(count, sizeof count, "%zd", done);
    if (offset < 0) offset = lseek(fd, 0, SEEK_CUR) - done;
    leave(done > 0, "write", path, offset, count, bytes, done > 0 ? done : 0);
}

ssize_t write(int fd, const void *bytes, size_t length) {
    char path[PATH_MAX];
    if (!named(fd, path)) return REAL(write)(fd, bytes, length);
    int dies = 0, error = enter(BOTH, &length, &dies);
    if (error) return fail(error);
    ssize_t done = REAL(write)(fd, bytes, length);
    if (dies) die();
    leave_write(fd, done, path, -1, bytes);
    return done;
}

ssize_t pwrite64(int fd, const void *bytes, size_t length, off64_t offset) {
    char path[PATH_MAX];
    if (!named(fd, path)) return REAL(pwrite64)(fd, bytes, length, offset);
    int dies = 0, error = enter(BOTH, &length, &dies);
    if (error) return fail(error);
    ssize_t done = REAL(pwrite64)(fd, bytes, length, offset);
    if (dies) die();
    leave_write(fd, done, path, offset, bytes);
    return done;
}

// Only the first buffer is written, which a caller has to expect.
ssize_t writev(int fd, const struct iovec *buffers, int count) {
    char path[PATH_MAX];
    if (!named(fd, path)) return REAL(writev)(fd, buffers, count);
    for (; count > 1 && !buffers->iov_len; count--) buffers++;
    return count ? write(fd, buffers->iov_base, buffers->iov_len) : 0;
}

// As if the system had no such call: the caller reads and writes.
ssize_t copy_file_range(int from, off64_t *from_at, int to, off64_t *to_at, size_t length, unsigned flags) {
    char path[PATH_MAX];
    if (!named(to, path)) return REAL(copy_file_range)(from, from_at, to, to_at, length, flags);
    errno = ENOSYS;
    return -1;
}

ssize_t sendfile64(int to, int from, off64_t *from_at, size_t length) {
    char path[PATH_MAX];
    ssize_t (*real)(int, int, off64_t *, size_t) = dlsym(RTLD_NEXT, "sendfile64");
    if (!named(to, path)) return real(to, from, from_at, length);
    errno = ENOSYS;
    return -1;
}

int ftruncate64(int fd, off64_t length) {
    char path[PATH_MAX];
    if (!named(fd, path)) return REAL(ftruncate64)(fd, length);
    ENTER(BOTH);
    int outcome = REAL(ftruncate64)(fd, length);
    leave(!outcome, "truncate", path, length, "", "", 0);
    return outcome;
}

#define SYNC(name)                                    \
    int name(int fd) {                                \
        char path[PATH_MAX];                          \
        if (!named(fd, path)) return REAL(name)(fd);  \
        ENTER(TO_BE_TRIED_AGAIN);                     \
        int outcome = REAL(name)(fd);                 \
        leave(!outcome, "sync", path, 0, "", "", 0);  \
        return outcome;                               \
    }
SYNC(fsync)
SYNC(fdatasync)

int statx(int folder, const char *restrict name, int flags, unsigned mask, struct statx *restrict found) {
    char link[64], path[PATH_MAX];
    double seconds = 1e9, hidden = atof(setting("FAULT_HIDE"));
    if (name && *name) {
        seconds = age(folder, name);
    } else if (hidden > 0) {
        // The size of an open file.
        snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
        ssize_t length = readlink(link, path, sizeof path - 1);
        if (length > 0 && path[0] == '/') {
            path[length] = 0;
            seconds = age(AT_FDCWD, path);
        }
    }
    if (seconds < hidden && name && *name) {
        errno = ENOENT;
        return -1;
    }
    int outcome = REAL(statx)(folder, name, flags, mask, found);
    if (!outcome && seconds < 2 * hidden) found->stx_size /= 2;
    return outcome;
}

// Opening counts where it makes a file or empties one.
static int open_counted(int folder, const char *name, int flags, mode_t mode) {
    char path[PATH_MAX];
    __typeof__(&openat64) real = REAL(openat64);
    if (!(flags & O_CREAT) && age(folder, name) < atof(setting("FAULT_HIDE"))) {
        errno = ENOENT;
        return -1;
    }
    if (!(flags & (O_CREAT | O_TRUNC)) || !absolute(folder, name, path)) return real(folder, name, flags, mode);
    int was_there = access(path, F_OK) == 0;
    if (was_there && !(flags & O_TRUNC)) return real(folder, name, flags, mode);
    ENTER(BOTH);
    int fd = real(folder, name, flags, mode);
    leave(fd >= 0, was_there ? "truncate" : "create", path, 0, "", "", 0);
    return fd;
}

#define MODE(flags)                               \
    mode_t mode = 0;                              \
    if ((flags) & (O_CREAT | __O_TMPFILE)) {      \
        va_list more;                             \
        va_start(more, flags);                    \
        mode = va_arg(more, mode_t);              \
        va_end(more);                             \
    }
int open(const char *name, int flags, ...) { MODE(flags) return open_counted(AT_FDCWD, name, flags, mode); }
int open64(const char *name, int flags, ...) {
    MODE(flags) return open_counted(AT_FDCWD, name, flags | O_LARGEFILE, mode);
}
int openat(int folder, const char *name, int flags, ...) { MODE(flags) return open_counted(folder, name, flags, mode); }
int openat64(int folder, const char *name, int flags, ...) {
    MODE(flags) return open_counted(folder, name, flags | O_LARGEFILE, mode);
}

// Calls of one name, and of two.
#define CHANGE(function, operation, need, parameters, folder, name, arguments) \
    int function parameters {                                                  \
        char path[PATH_MAX];                                                   \
        if (!absolute(folder, name, path)) return REAL(function) arguments;    \
        ENTER(need);                                                           \
        int outcome = REAL(function) arguments;                                \
        leave(!outcome, operation, path, 0, "", "", 0);                        \
        return outcome;                                                        \
    }
CHANGE(unlink, "remove", NOTHING, (const char *name), AT_FDCWD, name, (name))
CHANGE(unlinkat, "remove", NOTHING, (int folder, const char *name, int flags), folder, name, (folder, name, flags))
CHANGE(rmdir, "remove", NOTHING, (const char *name), AT_FDCWD, name, (name))
CHANGE(mkdir, "folder", SPACE, (const char *name, mode_t mode), AT_FDCWD, name, (name, mode))
CHANGE(mkdirat, "folder", SPACE, (int folder, const char *name, mode_t mode), folder, name, (folder, name, mode))

#define RENAME(function, parameters, from_folder, to_folder, arguments)                         \
    int function parameters {                                                                    \
        char source[PATH_MAX], target[PATH_MAX];                                                 \
        int inside = absolute(from_folder, from, source);                                        \
        if (!absolute(to_folder, to, target) || !inside) return REAL(function) arguments;        \
        ENTER(NOTHING);                                                                          \
        int outcome = REAL(function) arguments;                                                  \
        leave(!outcome, "rename", source, 0, target, "", 0);                                     \
        return outcome;                                                                          \
    }
RENAME(rename, (const char *from, const char *to), AT_FDCWD, AT_FDCWD, (from, to))
RENAME(renameat, (int from_folder, const char *from, int to_folder, const char *to), from_folder, to_folder,
       (from_folder, from, to_folder, to))
