#pragma once

#include <sys/types.h>

#include <filesystem>
#include <string>
#include <vector>

namespace stillmap::bench {

/// `stillmap serve` as a process of its own, so that its CPU time and memory can be told from the
/// generator's. Stops with SIGTERM when it goes.
class ServerProcess {
 public:
  /// Returns once every map is ready. @throws std::runtime_error when it does not come up.
  ServerProcess(const std::filesystem::path& program, const std::filesystem::path& store,
                int workers);
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;
  ~ServerProcess();

  [[nodiscard]] int port() const { return port_; }
  /// User and system time since it was started [s].
  [[nodiscard]] double cpu_s() const;
  /// Resident memory that is not a file's [MiB].
  [[nodiscard]] double memory_mib() const;

 private:
  pid_t pid_ = -1;
  int port_ = 0;
};

}  // namespace stillmap::bench
