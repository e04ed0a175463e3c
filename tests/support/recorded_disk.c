/* Loaded before libc: appends each call that changes files of the folder $OPIR_DISK to the file $OPIR_DISK_LOG.

   A record is a struct record, two names and the bytes written. Only calls that succeeded are recorded, in the order in
   which they were made: a lock is held during each call. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

enum { OPEN = 1, WRITE, SYNC, TRUNCATE, RENAME, UNLINK, MKDIR, RMDIR };
enum { MOST_DESCRIPTORS = 65536 };

struct record {
    uint32_t kind, first_length, second_length, padding;
    uint64_t time_ns, inode;
    int64_t offset;
    uint64_t size;
};

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static const char *folder;
static size_t folder_length;
static int log_descriptor = -1;
static char watched[MOST_DESCRIPTORS];

#define REAL(name) ((__typeof__(name) *)dlsym(RTLD_NEXT, #name))

__attribute__((constructor)) static void begin(void)
{
    const char *log = getenv("OPIR_DISK_LOG");
    const char *place = getenv("OPIR_DISK");
    if (!log || !place)
        return;
    log_descriptor = REAL(open)(log, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
    folder_length = strlen(place);
    folder = place;
}

static int is_ours(const char *path)
{
    return folder && !strncmp(path, folder, folder_length) && (path[folder_length] == '/' || !path[folder_length]);
}

static void put(const void *bytes, size_t size)
{
    if (REAL(write)(log_descriptor, bytes, size) != (ssize_t)size)
        abort();
}

static void note(uint32_t kind, const char *first, const char *second, ino_t inode, off_t offset, const void *bytes,
                 size_t size)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    struct record record = {kind, strlen(first), strlen(second), 0, now.tv_sec * 1000000000ull + now.tv_nsec, inode,
                            offset, size};
    put(&record, sizeof record);
    put(first, record.first_length);
    put(second, record.second_length);
    if (bytes)
        put(bytes, size);
}

static ino_t inode_of(int descriptor)
{
    struct stat found;
    return fstat(descriptor, &found) ? 0 : found.st_ino;
}

static int is_watched(int descriptor)
{
    return descriptor >= 0 && descriptor < MOST_DESCRIPTORS && watched[descriptor];
}

/* Write the absolute path of a name relative to an open folder. */
static void absolute(int at, const char *name, char *path)
{
    char base[PATH_MAX / 2] = "", link[64];
    if (name[0] != '/') {
        snprintf(link, sizeof link, at == AT_FDCWD ? "/proc/self/cwd" : "/proc/self/fd/%d", at);
        ssize_t length = readlink(link, base, sizeof base - 1);
        base[length < 0 ? 0 : length] = 0;
    }
    snprintf(path, PATH_MAX, "%s%s%.2000s", base, name[0] == '/' ? "" : "/", name);
}

static void opened(int descriptor, int flags)
{
    char link[64], path[PATH_MAX];
    if (descriptor < 0 || descriptor >= MOST_DESCRIPTORS || !folder)
        return;
    snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
    ssize_t length = readlink(link, path, sizeof path - 1);
    path[length < 0 ? 0 : length] = 0;
    watched[descriptor] = is_ours(path);
    if (watched[descriptor])
        note(OPEN, path, "", inode_of(descriptor), flags & (O_CREAT | O_TRUNC) ? flags & O_TRUNC : -1, NULL, 0);
}

#define CALL(type, name, parameters, given, then)                                                                      \
    type name parameters                                                                                               \
    {                                                                                                                  \
        pthread_mutex_lock(&lock);                                                                                     \
        type answer = REAL(name) given;                                                                                \
        then;                                                                                                          \
        pthread_mutex_unlock(&lock);                                                                                   \
        return answer;                                                                                                 \
    }

#define MODE                                                                                                           \
    va_list rest;                                                                                                      \
    va_start(rest, flags);                                                                                             \
    mode_t mode = flags & O_CREAT ? va_arg(rest, mode_t) : 0;                                                          \
    va_end(rest)

#define OPENING(name)                                                                                                  \
    int name(const char *path, int flags, ...)                                                                         \
    {                                                                                                                  \
        MODE;                                                                                                          \
        pthread_mutex_lock(&lock);                                                                                     \
        int answer = REAL(name)(path, flags, mode);                                                                    \
        opened(answer, flags);                                                                                         \
        pthread_mutex_unlock(&lock);                                                                                   \
        return answer;                                                                                                 \
    }

#define OPENING_AT(name)                                                                                               \
    int name(int at, const char *path, int flags, ...)                                                                 \
    {                                                                                                                  \
        MODE;                                                                                                          \
        pthread_mutex_lock(&lock);                                                                                     \
        int answer = REAL(name)(at, path, flags, mode);                                                                \
        opened(answer, flags);                                                                                         \
        pthread_mutex_unlock(&lock);                                                                                   \
        return answer;                                                                                                 \
    }

OPENING(open)
OPENING(open64)
OPENING_AT(openat)
OPENING_AT(openat64)

static void written(int descriptor, const void *bytes, ssize_t size, off_t offset)
{
    if (size > 0 && is_watched(descriptor)) {
        off_t at = offset < 0 ? lseek(descriptor, 0, SEEK_CUR) - size : offset;
        note(WRITE, "", "", inode_of(descriptor), at, bytes, size);
    }
}

CALL(ssize_t, write, (int file, const void *bytes, size_t size), (file, bytes, size), written(file, bytes, answer, -1))
CALL(ssize_t, pwrite, (int file, const void *bytes, size_t size, off_t at), (file, bytes, size, at),
     written(file, bytes, answer, at))
CALL(ssize_t, pwrite64, (int file, const void *bytes, size_t size, off64_t at), (file, bytes, size, at),
     written(file, bytes, answer, at))

static void on_descriptor(uint32_t kind, int answer, int descriptor, off_t size)
{
    if (!answer && is_watched(descriptor))
        note(kind, "", "", inode_of(descriptor), size, NULL, 0);
}

CALL(int, fsync, (int file), (file), on_descriptor(SYNC, answer, file, 0))
CALL(int, fdatasync, (int file), (file), on_descriptor(SYNC, answer, file, 0))
CALL(int, ftruncate, (int file, off_t size), (file, size), on_descriptor(TRUNCATE, answer, file, size))
CALL(int, ftruncate64, (int file, off64_t size), (file, size), on_descriptor(TRUNCATE, answer, file, size))

static void closed(int descriptor)
{
    if (descriptor >= 0 && descriptor < MOST_DESCRIPTORS)
        watched[descriptor] = 0;
}

CALL(int, close, (int file), (file), closed(file))

static void on_names(uint32_t kind, int answer, int at, const char *name, int to, const char *target)
{
    char path[PATH_MAX], other[PATH_MAX] = "";
    if (answer || !folder)
        return;
    absolute(at, name, path);
    if (target)
        absolute(to, target, other);
    if (is_ours(path) || is_ours(other))
        note(kind, path, other, 0, 0, NULL, 0);
}

CALL(int, rename, (const char *from, const char *to), (from, to),
     on_names(RENAME, answer, AT_FDCWD, from, AT_FDCWD, to))
CALL(int, renameat, (int at, const char *from, int there, const char *to), (at, from, there, to),
     on_names(RENAME, answer, at, from, there, to))
CALL(int, unlink, (const char *path), (path), on_names(UNLINK, answer, AT_FDCWD, path, 0, NULL))
CALL(int, unlinkat, (int at, const char *path, int flags), (at, path, flags),
     on_names(flags & AT_REMOVEDIR ? RMDIR : UNLINK, answer, at, path, 0, NULL))
CALL(int, mkdir, (const char *path, mode_t mode), (path, mode), on_names(MKDIR, answer, AT_FDCWD, path, 0, NULL))
CALL(int, mkdirat, (int at, const char *path, mode_t mode), (at, path, mode),
     on_names(MKDIR, answer, at, path, 0, NULL))
CALL(int, rmdir, (const char *path), (path), on_names(RMDIR, answer, AT_FDCWD, path, 0, NULL))
