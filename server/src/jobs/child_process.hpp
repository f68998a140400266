#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace stillmap::server {

/// A file descriptor that is closed when it is let go.
class Descriptor {
 public:
  Descriptor() = default;
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() { reset(); }
  Descriptor(Descriptor&& other) noexcept : fd_(other.release()) {}
  Descriptor& operator=(Descriptor&& other) noexcept;
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  [[nodiscard]] int get() const { return fd_; }
  [[nodiscard]] bool is_open() const { return fd_ >= 0; }
  void reset();

 private:
  int release();
  int fd_ = -1;
};

/// How a process ended.
struct ProcessEnd {
  /// Of a process that ended by itself; -1 when a signal ended it.
  int exit_code = -1;
  /// 0 unless a signal ended it.
  int signal = 0;
  /// "exit code 3", "signal 11 (Segmentation fault)".
  [[nodiscard]] std::string words() const;
};

/// What a program may take from the machine.
struct ProcessLimits {
  /// Added to the niceness of this process.
  int nice = 0;
  /// Of those that this process may use, the last so many; 0 = all.
  int cores = 0;
  /// Address space [bytes]; 0 = no bound of its own.
  std::int64_t memory_bytes = 0;
};

/// A program that runs beside the server: in a process group of its own, without our files, first
/// to go when memory is short, and killed when the thread that started it, or the whole server, is
/// gone. Its stdout and stderr come through one pipe, what it writes to descriptor `kProgress`
/// through another; both must be read. For one thread, which must live until the end.
class ChildProcess {
 public:
  /// Descriptor of the program.
  static constexpr int kProgress = 3;

  /// @param arguments  program first. @throws std::runtime_error when it cannot be started.
  ChildProcess(const std::vector<std::string>& arguments, const ProcessLimits& limits);
  /// Kills it when it has not ended.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// Reading ends, which never block.
  [[nodiscard]] int output() const { return output_.get(); }
  [[nodiscard]] int progress() const { return progress_.get(); }
  [[nodiscard]] pid_t pid() const { return pid_; }
  /// To the whole group; nothing once it has ended.
  void signal(int number) const;
  /// Whether it has ended; what is left of its group is then killed.
  [[nodiscard]] bool has_ended();
  /// Once it has ended.
  [[nodiscard]] const ProcessEnd& end() const { return end_; }

 private:
  pid_t pid_ = -1;
  bool ended_ = false;
  ProcessEnd end_;
  Descriptor output_;
  Descriptor progress_;
};

}  // namespace stillmap::server
