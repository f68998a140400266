// Preloaded together with libfiu's fiu_posix_preload.so: lets exactly the n-th call of one of
// libfiu's failure points fail. mkdir, rmdir, linkat and renameat2, which libfiu does not know, are
// added here as points of their own.
//
// STILLMAP_NTH_CALL names a file of the size of `Shared`, which the test has mapped too.

// Without it the header of libfiu is empty.
#define FIU_ENABLE

#include <dlfcn.h>
#include <fcntl.h>
#include <fiu-control.h>
#include <fiu.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

namespace {

/// faults.py has the same list.
constexpr std::array<std::string_view, 18> kPoints = {
    "posix/io/oc/open",
    "posix/io/rw/pwrite",
    "posix/io/rw/pwrite/reduce",
    "posix/io/rw/write",
    "posix/io/rw/write/reduce",
    "posix/io/rw/ftruncate",
    "posix/io/sync/fsync",
    "posix/io/sync/fdatasync",
    "posix/io/dir/rename",
    "posix/io/dir/unlink",
    "posix/io/dir/opendir",
    "posix/io/rw/pread",
    "posix/io/rw/read",
    "posix/mm/mmap",
    "stillmap/mkdir",
    "stillmap/rmdir",
    "stillmap/linkat",
    "stillmap/renameat2",
};

/// In place of an error: the process is killed before the call. faults.py has the same number.
constexpr std::int64_t kKilled = -1;

struct Shared {
  /// The call to fail, counted from 0.
  std::atomic<std::int64_t> fails_at;
  /// 1 once it has failed.
  std::atomic<std::int64_t> failed;
  std::atomic<std::int64_t> error;
  /// Which of the points; none when it is beyond them.
  std::atomic<std::int64_t> point;
  /// Calls of each point.
  std::array<std::atomic<std::int64_t>, kPoints.size()> made;
};
static_assert(std::atomic<std::int64_t>::is_always_lock_free);
Shared* shared = nullptr;

/// libfiu asks it whenever one of the points is reached.
int is_the_one(const char* name, int*, void** info, unsigned int*) {
  const auto at = std::find(kPoints.begin(), kPoints.end(), std::string_view(name));
  if (at == kPoints.end()) return 0;
  const std::ptrdiff_t point = at - kPoints.begin();
  const std::int64_t n = shared->made[static_cast<std::size_t>(point)].fetch_add(1);
  if (shared->point != point || n != shared->fails_at) return 0;
  if (shared->error == kKilled) kill(getpid(), SIGKILL);
  *info = reinterpret_cast<void*>(static_cast<std::intptr_t>(shared->error));
  shared->failed = 1;
  return 1;
}

__attribute__((constructor)) void enable() {
  const char* file = std::getenv("STILLMAP_NTH_CALL");
  if (file == nullptr) return;
  const int descriptor = open(file, O_RDWR | O_CLOEXEC);
  if (descriptor < 0) _exit(99);
  void* mapped = mmap(nullptr, sizeof(Shared), PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
  close(descriptor);
  if (mapped == MAP_FAILED) _exit(99);
  shared = static_cast<Shared*>(mapped);
  fiu_init(0);
  for (const std::string_view point : kPoints)
    if (fiu_enable_external(point.data(), 1, nullptr, 0, is_the_one) != 0) _exit(99);
}

/// @return whether this call fails; errno is set then.
bool fails(const char* point) {
  if (fiu_fail(point) == 0) return false;
  errno = static_cast<int>(reinterpret_cast<std::intptr_t>(fiu_failinfo()));
  return true;
}

template <typename Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

}  // namespace

extern "C" {

int mkdir(const char* path, mode_t mode) noexcept {
  return fails("stillmap/mkdir") ? -1 : next<int(const char*, mode_t)>("mkdir")(path, mode);
}

int rmdir(const char* path) noexcept {
  return fails("stillmap/rmdir") ? -1 : next<int(const char*)>("rmdir")(path);
}

int linkat(int from_at, const char* from, int to_at, const char* to, int flags) noexcept {
  using Function = int(int, const char*, int, const char*, int);
  return fails("stillmap/linkat") ? -1 : next<Function>("linkat")(from_at, from, to_at, to, flags);
}

int renameat2(int from_at, const char* from, int to_at, const char* to,
              unsigned int flags) noexcept {
  using Function = int(int, const char*, int, const char*, unsigned int);
  return fails("stillmap/renameat2") ? -1
                                     : next<Function>("renameat2")(from_at, from, to_at, to, flags);
}

}  // extern "C"
