// SPDX-License-Identifier: Apache-2.0
// Preloaded into the program (LD_PRELOAD): counts the file operations under one folder and disturbs the N-th.
//   FILE_FAULTS_UNDER  absolute folder, without a link in it; operations elsewhere are not counted
//   FILE_FAULTS_AT     N, from 1; 0 or unset: none is disturbed
//   FILE_FAULTS_KIND   error: the N-th fails with EIO; full: it and all later ones that need space fail with ENOSPC;
//                      kill: SIGKILL in place of it. A write is done by half before, as a real one may be.
//   FILE_FAULTS_LOG    file that gets a line for each operation
//   FILE_FAULTS_HURRY  the steady clock runs so many times as fast, so that what is timed for a second takes none
// Operations: open to write, write, fsync, ftruncate, rename, link, unlink, rmdir, mkdir, chmod.
// What stdio writes from inside the C library is not seen; the program writes through descriptors.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

enum { kNone, kError, kFull, kKill };

static char g_under[PATH_MAX];
static long g_at;
static int g_kind;
static int g_log = -1;
static long g_hurry = 1;
static atomic_long g_count;
static pthread_once_t g_once = PTHREAD_ONCE_INIT;

static void read_settings(void) {
  const char* const under = getenv("FILE_FAULTS_UNDER");
  const char* const at = getenv("FILE_FAULTS_AT");
  const char* const kind = getenv("FILE_FAULTS_KIND");
  const char* const log = getenv("FILE_FAULTS_LOG");
  const char* const hurry = getenv("FILE_FAULTS_HURRY");
  if (under) snprintf(g_under, sizeof g_under, "%s", under);
  if (at) g_at = atol(at);
  if (hurry && atol(hurry) > 0) g_hurry = atol(hurry);
  if (kind) g_kind = strcmp(kind, "full") == 0 ? kFull : strcmp(kind, "kill") == 0 ? kKill : kError;
  if (log) g_log = (int)syscall(SYS_openat, AT_FDCWD, log, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
}

static int is_under(const char* path) {
  const size_t length = strlen(g_under);
  return length > 0 && strncmp(path, g_under, length) == 0 && (path[length] == '/' || path[length] == '\0');
}

/// The path that a folder's descriptor and a name make.
static void join(int folder, const char* name, char* path) {
  size_t length = 0;
  if (name[0] != '/') {
    char link[64];
    if (folder == AT_FDCWD) {
      snprintf(link, sizeof link, "/proc/self/cwd");
    } else {
      snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
    }
    const ssize_t found = readlink(link, path, PATH_MAX - 1);
    length = found > 0 ? (size_t)found : 0;
    path[length++] = '/';
  }
  snprintf(path + length, PATH_MAX + 1 - length, "%s", name);
}

/// Counts the operation.
/// @return what shall happen to it
static int disturbed(const char* operation, int needs_space, const char* path) {
  pthread_once(&g_once, read_settings);
  if (!is_under(path)) return kNone;
  const long number = atomic_fetch_add(&g_count, 1) + 1;
  if (g_log >= 0) {
    char line[PATH_MAX + 64];
    const int length = snprintf(line, sizeof line, "%ld %s %s\n", number, operation, path + strlen(g_under));
    syscall(SYS_write, g_log, line, (size_t)length);
  }
  if (g_at == 0 || number < g_at || (number > g_at && g_kind != kFull)) return kNone;
  return g_kind == kFull && !needs_space ? kNone : g_kind;
}

static int refuse(int kind) {
  if (kind == kKill) {
    raise(SIGKILL);
    pause();
  }
  errno = kind == kFull ? ENOSPC : EIO;
  return -1;
}

// ISO C knows no conversion of an object pointer to a function pointer; POSIX requires it.
#define REAL(name) ((__typeof__(&name))(uintptr_t)dlsym(RTLD_NEXT, #name))
#define FAIL_AT(operation, needs_space, folder, name)               \
  do {                                                              \
    char full_path[PATH_MAX + 1];                                   \
    join(folder, name, full_path);                                  \
    const int kind_ = disturbed(operation, needs_space, full_path); \
    if (kind_ != kNone) return refuse(kind_);                       \
  } while (0)

static int opens(int folder, const char* name, int flags) {
  if ((flags & O_ACCMODE) == O_RDONLY && (flags & (O_CREAT | O_TRUNC)) == 0) return 0;
  FAIL_AT("open", 1, folder, name);
  return 0;
}

#define MODE_OF(flags)                                              \
  mode_t mode = 0;                                                  \
  if ((flags & O_CREAT) != 0 || (flags & O_TMPFILE) == O_TMPFILE) { \
    va_list rest;                                                   \
    va_start(rest, flags);                                          \
    mode = va_arg(rest, mode_t);                                    \
    va_end(rest);                                                   \
  }

int open(const char* name, int flags, ...) {
  MODE_OF(flags)
  return opens(AT_FDCWD, name, flags) != 0 ? -1 : REAL(open)(name, flags, mode);
}
int open64(const char* name, int flags, ...) {
  MODE_OF(flags)
  return opens(AT_FDCWD, name, flags) != 0 ? -1 : REAL(open64)(name, flags, mode);
}
int openat(int folder, const char* name, int flags, ...) {
  MODE_OF(flags)
  return opens(folder, name, flags) != 0 ? -1 : REAL(openat)(folder, name, flags, mode);
}
int openat64(int folder, const char* name, int flags, ...) {
  MODE_OF(flags)
  return opens(folder, name, flags) != 0 ? -1 : REAL(openat64)(folder, name, flags, mode);
}
FILE* fopen(const char* name, const char* mode) {
  if (mode[0] != 'r' && opens(AT_FDCWD, name, O_WRONLY) != 0) return NULL;
  return REAL(fopen)(name, mode);
}
FILE* fopen64(const char* name, const char* mode) {
  if (mode[0] != 'r' && opens(AT_FDCWD, name, O_WRONLY) != 0) return NULL;
  return REAL(fopen64)(name, mode);
}

static int disturbed_descriptor(const char* operation, int needs_space, int descriptor) {
  char link[64];
  char path[PATH_MAX];
  snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
  const ssize_t length = readlink(link, path, sizeof path - 1);
  if (length <= 0) return kNone;
  path[length] = '\0';
  return disturbed(operation, needs_space, path);
}

ssize_t write(int descriptor, const void* data, size_t bytes) {
  const int kind = disturbed_descriptor("write", 1, descriptor);
  if (kind == kNone) return REAL(write)(descriptor, data, bytes);
  syscall(SYS_write, descriptor, data, bytes / 2);
  return refuse(kind);
}
ssize_t writev(int descriptor, const struct iovec* parts, int count) {
  const int kind = disturbed_descriptor("write", 1, descriptor);
  return kind == kNone ? REAL(writev)(descriptor, parts, count) : refuse(kind);
}
int fsync(int descriptor) {
  const int kind = disturbed_descriptor("fsync", 1, descriptor);
  return kind == kNone ? REAL(fsync)(descriptor) : refuse(kind);
}
int ftruncate(int descriptor, off_t length) {
  const int kind = disturbed_descriptor("ftruncate", 1, descriptor);
  return kind == kNone ? REAL(ftruncate)(descriptor, length) : refuse(kind);
}
int fchmod(int descriptor, mode_t mode) {
  const int kind = disturbed_descriptor("chmod", 0, descriptor);
  return kind == kNone ? REAL(fchmod)(descriptor, mode) : refuse(kind);
}
int rename(const char* from, const char* to) {
  FAIL_AT("rename", 0, AT_FDCWD, to);
  return REAL(rename)(from, to);
}
int link(const char* from, const char* to) {
  FAIL_AT("link", 1, AT_FDCWD, to);
  return REAL(link)(from, to);
}
int unlink(const char* name) {
  FAIL_AT("unlink", 0, AT_FDCWD, name);
  return REAL(unlink)(name);
}
int unlinkat(int folder, const char* name, int flags) {
  FAIL_AT("unlink", 0, folder, name);
  return REAL(unlinkat)(folder, name, flags);
}
int remove(const char* name) {
  FAIL_AT("unlink", 0, AT_FDCWD, name);
  return REAL(remove)(name);
}
int rmdir(const char* name) {
  FAIL_AT("rmdir", 0, AT_FDCWD, name);
  return REAL(rmdir)(name);
}
int mkdir(const char* name, mode_t mode) {
  FAIL_AT("mkdir", 1, AT_FDCWD, name);
  return REAL(mkdir)(name, mode);
}

int clock_gettime(clockid_t clock, struct timespec* now) {
  pthread_once(&g_once, read_settings);
  const int result = (int)syscall(SYS_clock_gettime, clock, now);
  if (result == 0 && clock == CLOCK_MONOTONIC && g_hurry > 1) {
    static _Atomic(long) start;
    long expected = 0;
    atomic_compare_exchange_strong(&start, &expected, (long)now->tv_sec);
    const long since = atomic_load(&start);
    const long long nanoseconds = ((long long)(now->tv_sec - since) * 1000000000LL + now->tv_nsec) * g_hurry;
    now->tv_sec = since + (time_t)(nanoseconds / 1000000000LL);
    now->tv_nsec = (long)(nanoseconds % 1000000000LL);
  }
  return result;
}
