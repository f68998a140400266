#pragma once

#include "store/disk_calls.hpp"

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::test {

/// A change to the disk as it was made, with bytes of its own.
struct RecordedCall {
  server::DiskCall::Kind kind;
  std::filesystem::path path;
  std::filesystem::path to;
  std::uint64_t offset = 0;
  std::string bytes;
};

/// Lets every change pass but the syncs, which only cost time where no power is ever cut.
class UnsyncedCalls : public server::DiskCalls {
 public:
  std::int64_t pass(const server::DiskCall& call, const Perform& perform) override {
    const bool syncs = call.kind == server::DiskCall::Kind::kSyncFile ||
                       call.kind == server::DiskCall::Kind::kSyncFolder;
    return syncs ? 0 : perform(call.bytes.size());
  }
};

/// Keeps what was changed on the disk, in order; what failed is left out.
class RecordingCalls : public UnsyncedCalls {
 public:
  std::int64_t pass(const server::DiskCall& call, const Perform& perform) override {
    const std::scoped_lock lock(mutex_);
    const std::int64_t result = UnsyncedCalls::pass(call, perform);
    if (result < 0) return result;
    const bool writes = call.kind == server::DiskCall::Kind::kWrite;
    calls_.push_back(
        {call.kind, call.path, call.to, call.offset,
         std::string(call.bytes.substr(0, writes ? static_cast<std::size_t>(result) : 0))});
    return result;
  }
  [[nodiscard]] const std::vector<RecordedCall>& calls() const { return calls_; }

 private:
  std::mutex mutex_;
  std::vector<RecordedCall> calls_;
};

/// A disk that can be filled up. Nothing is written then until room is made by removing the file
/// that a store keeps for that.
class FullDisk : public UnsyncedCalls {
 public:
  std::int64_t pass(const server::DiskCall& call, const Perform& perform) override {
    using Kind = server::DiskCall::Kind;
    if (full_ && (call.kind == Kind::kWrite || call.kind == Kind::kAllocate)) return -ENOSPC;
    const std::int64_t result = UnsyncedCalls::pass(call, perform);
    if (call.kind == Kind::kRemoveFile && call.path.filename() == ".ballast" && result == 0)
      full_ = false;
    return result;
  }
  void fill() { full_ = true; }
  [[nodiscard]] bool is_full() const { return full_; }

 private:
  std::atomic<bool> full_ = false;
};

/// What goes wrong at one call. A short write does half of it and says so.
enum class Fault { kNoSpace, kInputOutput, kShortWrite };

/// Lets every call pass but those that fail. Counts from 0.
class FailingCalls : public UnsyncedCalls {
 public:
  using Picks = std::function<bool(std::size_t n, const server::DiskCall& call)>;
  FailingCalls(Fault fault, Picks fails) : fault_(fault), fails_(std::move(fails)) {}

  std::int64_t pass(const server::DiskCall& call, const Perform& perform) override {
    const std::scoped_lock lock(mutex_);
    if (!fails_(count_++, call)) return UnsyncedCalls::pass(call, perform);
    ++failed_;
    const bool writes = call.kind == server::DiskCall::Kind::kWrite;
    if (fault_ == Fault::kShortWrite && writes && call.bytes.size() > 1)
      return perform(call.bytes.size() / 2);
    return fault_ == Fault::kInputOutput ? -EIO : -ENOSPC;
  }
  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] std::size_t failed() const { return failed_; }

 private:
  std::mutex mutex_;
  Fault fault_;
  Picks fails_;
  std::size_t count_ = 0;
  std::size_t failed_ = 0;
};

}  // namespace stillmap::test
