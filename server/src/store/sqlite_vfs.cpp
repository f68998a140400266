#include "store/sqlite_vfs.hpp"

#include <fcntl.h>
#include <sqlite3.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <filesystem>
#include <new>
#include <stdexcept>
#include <string_view>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;
using Kind = DiskCall::Kind;

int code_of(std::int64_t result, int otherwise) {
  return result == -ENOSPC || result == -EDQUOT ? SQLITE_FULL : otherwise;
}

std::int64_t sync_descriptor_of(const fs::path& folder) {
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return -errno;
  const std::int64_t result = ::fsync(descriptor) == 0 ? 0 : -errno;
  ::close(descriptor);
  return result;
}

}  // namespace

struct SqliteVfs::Registration {
  sqlite3_vfs vfs{};
  sqlite3_vfs* inner = nullptr;
};

/// The functions that SQLite calls. They may not throw, and `DiskCalls` does not.
struct SqliteVfs::Methods {
  /// SQLite gives us the memory; that of the inner layer's file lies behind it.
  struct File {
    sqlite3_file base;
    SqliteVfs* owner;
    /// SQLite keeps it until the file is closed; null for a file without a name, which never lasts.
    const char* name;
    bool folder_unsynced;
  };
  static_assert(sizeof(File) % alignof(std::max_align_t) == 0 || sizeof(File) % 8 == 0);

  static File& of(sqlite3_file* file) { return *reinterpret_cast<File*>(file); }
  static sqlite3_file* inner(sqlite3_file* file) {
    return reinterpret_cast<sqlite3_file*>(&of(file) + 1);
  }
  static SqliteVfs& owner(sqlite3_vfs* vfs) { return *static_cast<SqliteVfs*>(vfs->pAppData); }
  static sqlite3_vfs* inner(sqlite3_vfs* vfs) { return owner(vfs).registration_->inner; }

  /// SQLite cleans up, with more calls, before anyone asks for the reason, and forgets that of a
  /// commit.
  static void note(SqliteVfs& self, int code, std::int64_t result) {
    if (result >= 0) return;
    sqlite3_vfs* inner = self.registration_->inner;
    const int failure =
        code == SQLITE_OK ? static_cast<int>(-result) : inner->xGetLastError(inner, 0, nullptr);
    self.failure_ = failure;
    if (failure != ENOSPC && failure != EDQUOT) self.refused_ = failure;
  }

  /// Passes a call on; `perform` gives SQLite's code. @return SQLite's code.
  template <typename Perform>
  static int pass(SqliteVfs& self, const DiskCall& call, int otherwise, const Perform& perform) {
    int code = SQLITE_OK;
    const std::int64_t result = self.calls_.pass(call, [&](std::size_t) -> std::int64_t {
      code = perform();
      return code == SQLITE_OK ? 0 : -EIO;
    });
    note(self, code, result);
    if (code != SQLITE_OK) return code;
    return result < 0 ? code_of(result, otherwise) : SQLITE_OK;
  }

  static int sync_folder(SqliteVfs& self, const fs::path& file) {
    const fs::path folder = file.parent_path();
    const int code =
        pass(self, {.kind = Kind::kSyncFolder, .path = folder}, SQLITE_IOERR_DIR_FSYNC,
             [&] { return sync_descriptor_of(folder) == 0 ? SQLITE_OK : SQLITE_IOERR_DIR_FSYNC; });
    if (code != SQLITE_OK) self.sync_failed_ = true;
    return code;
  }

  /// A database holds hashes of keys and who did what: its owner alone reads it, whatever the
  /// umask says. SQLite gives its log the same mode. An error is met again by whoever opens it.
  static void create_private(const char* name) {
    const int descriptor = ::open(name, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    if (descriptor >= 0) ::close(descriptor);
  }

  static int open(sqlite3_vfs* vfs, const char* name, sqlite3_file* file, int flags, int* got) {
    const auto perform = [&] {
      if ((flags & SQLITE_OPEN_CREATE) != 0 && (flags & SQLITE_OPEN_MAIN_DB) != 0 &&
          name != nullptr)
        create_private(name);
      return inner(vfs)->xOpen(inner(vfs), name, inner(file), flags, got);
    };
    File& opened = *new (file) File{{nullptr}, &owner(vfs), name, false};
    const bool creates =
        name != nullptr && (flags & SQLITE_OPEN_CREATE) != 0 && ::access(name, F_OK) != 0;
    const int code = creates ? pass(owner(vfs), {.kind = Kind::kCreateFile, .path = name},
                                    SQLITE_CANTOPEN, perform)
                             : perform();
    opened.folder_unsynced = creates;
    if (code == SQLITE_OK) opened.base.pMethods = methods();
    return code;
  }

  static int remove(sqlite3_vfs* vfs, const char* name, int) {
    const int code =
        pass(owner(vfs), {.kind = Kind::kRemoveFile, .path = name}, SQLITE_IOERR_DELETE,
             [&] { return inner(vfs)->xDelete(inner(vfs), name, 0); });
    return code == SQLITE_OK ? sync_folder(owner(vfs), name) : code;
  }

  static int write(sqlite3_file* file, const void* bytes, int size, sqlite3_int64 offset) {
    File& self = of(file);
    if (self.name == nullptr)
      return inner(file)->pMethods->xWrite(inner(file), bytes, size, offset);
    const DiskCall call{.kind = Kind::kWrite,
                        .path = self.name,
                        .offset = static_cast<std::uint64_t>(offset),
                        .bytes = {static_cast<const char*>(bytes), static_cast<std::size_t>(size)}};
    int code = SQLITE_OK;
    const std::int64_t result =
        self.owner->calls_.pass(call, [&](std::size_t count) -> std::int64_t {
          code = inner(file)->pMethods->xWrite(inner(file), bytes, static_cast<int>(count), offset);
          return code == SQLITE_OK ? static_cast<std::int64_t>(count) : -EIO;
        });
    note(*self.owner, code, result);
    if (code != SQLITE_OK) return code;
    if (result < 0) return code_of(result, SQLITE_IOERR_WRITE);
    return result < size ? SQLITE_FULL : SQLITE_OK;
  }

  static int truncate(sqlite3_file* file, sqlite3_int64 size) {
    const auto perform = [&] { return inner(file)->pMethods->xTruncate(inner(file), size); };
    File& self = of(file);
    if (self.name == nullptr) return perform();
    return pass(
        *self.owner,
        {.kind = Kind::kTruncate, .path = self.name, .offset = static_cast<std::uint64_t>(size)},
        SQLITE_IOERR_TRUNCATE, perform);
  }

  static int sync(sqlite3_file* file, int flags) {
    const auto perform = [&] { return inner(file)->pMethods->xSync(inner(file), flags); };
    File& self = of(file);
    if (self.name == nullptr) return perform();
    int code = pass(*self.owner, {.kind = Kind::kSyncFile, .path = self.name}, SQLITE_IOERR_FSYNC,
                    perform);
    if (code == SQLITE_OK && self.folder_unsynced) {
      code = sync_folder(*self.owner, self.name);
      self.folder_unsynced = code != SQLITE_OK;
    }
    if (code != SQLITE_OK) self.owner->sync_failed_ = true;
    if (code == SQLITE_OK) self.owner->refused_ = 0;
    return code;
  }

  static int control(sqlite3_file* file, int operation, void* argument) {
    // A hint would set the size behind our back.
    if (operation == SQLITE_FCNTL_SIZE_HINT) return SQLITE_OK;
    return inner(file)->pMethods->xFileControl(inner(file), operation, argument);
  }

  static int characteristics(sqlite3_file* file) {
    // See server/store.md: a torn write may spoil the sector around it.
    return inner(file)->pMethods->xDeviceCharacteristics(inner(file)) &
           ~SQLITE_IOCAP_POWERSAFE_OVERWRITE;
  }

  /// Nothing may be thrown through SQLite, and what is said of a call takes memory.
  template <auto kMethod, typename... Arguments>
  static int nothing_thrown(Arguments... arguments) {
    try {
      return kMethod(arguments...);
    } catch (...) {
      return SQLITE_IOERR_NOMEM;
    }
  }

  static const sqlite3_io_methods* methods() {
    static const sqlite3_io_methods all = make_methods();
    return &all;
  }

  /// Version 2: with the shared index of the log, without reading through a memory map.
  static sqlite3_io_methods make_methods() {
    sqlite3_io_methods m{};
    m.iVersion = 2;
    m.xClose = [](sqlite3_file* f) { return inner(f)->pMethods->xClose(inner(f)); };
    m.xRead = [](sqlite3_file* f, void* to, int n, sqlite3_int64 at) {
      return inner(f)->pMethods->xRead(inner(f), to, n, at);
    };
    m.xWrite = nothing_thrown<write>;
    m.xTruncate = nothing_thrown<truncate>;
    m.xSync = nothing_thrown<sync>;
    m.xFileSize = [](sqlite3_file* f, sqlite3_int64* size) {
      return inner(f)->pMethods->xFileSize(inner(f), size);
    };
    m.xLock = [](sqlite3_file* f, int l) { return inner(f)->pMethods->xLock(inner(f), l); };
    m.xUnlock = [](sqlite3_file* f, int l) { return inner(f)->pMethods->xUnlock(inner(f), l); };
    m.xCheckReservedLock = [](sqlite3_file* f, int* held) {
      return inner(f)->pMethods->xCheckReservedLock(inner(f), held);
    };
    m.xFileControl = control;
    m.xSectorSize = [](sqlite3_file* f) { return inner(f)->pMethods->xSectorSize(inner(f)); };
    m.xDeviceCharacteristics = characteristics;
    m.xShmMap = [](sqlite3_file* f, int page, int size, int extend, void volatile** at) {
      return inner(f)->pMethods->xShmMap(inner(f), page, size, extend, at);
    };
    m.xShmLock = [](sqlite3_file* f, int offset, int n, int flags) {
      return inner(f)->pMethods->xShmLock(inner(f), offset, n, flags);
    };
    m.xShmBarrier = [](sqlite3_file* f) { inner(f)->pMethods->xShmBarrier(inner(f)); };
    m.xShmUnmap = [](sqlite3_file* f, int removes) {
      return inner(f)->pMethods->xShmUnmap(inner(f), removes);
    };
    return m;
  }

  /// Clock, sleep, randomness and the like stay the inner layer's functions, called with it.
  static void fill(sqlite3_vfs& v) {
    v.xOpen = nothing_thrown<open>;
    v.xDelete = nothing_thrown<remove>;
    v.xGetLastError = [](sqlite3_vfs* s, int size, char* text) {
      return inner(s)->xGetLastError(inner(s), size, text);
    };
    v.xAccess = [](sqlite3_vfs* s, const char* name, int flags, int* result) {
      return inner(s)->xAccess(inner(s), name, flags, result);
    };
    v.xFullPathname = [](sqlite3_vfs* s, const char* name, int size, char* out) {
      return inner(s)->xFullPathname(inner(s), name, size, out);
    };
    v.xRandomness = [](sqlite3_vfs* s, int n, char* out) {
      return inner(s)->xRandomness(inner(s), n, out);
    };
    v.xSleep = [](sqlite3_vfs* s, int us) { return inner(s)->xSleep(inner(s), us); };
    v.xCurrentTime = [](sqlite3_vfs* s, double* t) { return inner(s)->xCurrentTime(inner(s), t); };
    v.xCurrentTimeInt64 = [](sqlite3_vfs* s, sqlite3_int64* t) {
      return inner(s)->xCurrentTimeInt64(inner(s), t);
    };
  }
};

SqliteVfs::SqliteVfs(DiskCalls& calls)
    : calls_(calls), registration_(std::make_unique<Registration>()) {
  static std::atomic<unsigned> count{0};
  name_ = "stillmap-" + std::to_string(count++);
  registration_->inner = sqlite3_vfs_find("unix");
  if (registration_->inner == nullptr) throw std::runtime_error("SQLite has no layer for Unix");
  sqlite3_vfs& vfs = registration_->vfs;
  vfs.iVersion = 2;
  vfs.szOsFile = static_cast<int>(sizeof(Methods::File)) + registration_->inner->szOsFile;
  vfs.mxPathname = registration_->inner->mxPathname;
  vfs.zName = name_.c_str();
  vfs.pAppData = this;
  Methods::fill(vfs);
  if (sqlite3_vfs_register(&vfs, 0) != SQLITE_OK)
    throw std::runtime_error("SQLite refuses a file system layer");
}

SqliteVfs::~SqliteVfs() { sqlite3_vfs_unregister(&registration_->vfs); }

}  // namespace stillmap::server
