#pragma once

#include "sealing/seal.hpp"

#include "store/package_store.hpp"
#include "store/seal_key_table.hpp"

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace stillmap::server {

/// How long a seal counts after it was made, and a key after the next one came.
inline constexpr std::chrono::seconds kSealLife{60};

/// Where the servers of one store get the keys that seal its sessions. Safe from several threads.
class SealKeySource {
 public:
  virtual ~SealKeySource() = default;
  SealKeySource() = default;
  SealKeySource(const SealKeySource&) = delete;
  SealKeySource& operator=(const SealKeySource&) = delete;

  /// The first one seals, all of them open; never empty.
  [[nodiscard]] virtual std::vector<SealKey> keys() = 0;
};

/// Keys in the file `seal.keys` of a store's folder: a line of 64 hex digits each, the newest
/// first. The second one counts for `kSealLife` after the file was written, later ones do not. A
/// file that is replaced is noticed within a second. A backup of the store does not have it.
class StoreSealKeys final : public SealKeySource {
 public:
  using Clock = std::chrono::system_clock;

  /// Reads the file; makes it, for its owner alone, when there is none. Where the disk takes no
  /// file, the key lives as long as this, and that is logged.
  /// @param now  for tests.
  /// @throws maps::InputError for a file without a key, maps::StorageError.
  explicit StoreSealKeys(const std::filesystem::path& store,
                         std::function<Clock::time_point()> now = Clock::now);

  [[nodiscard]] std::vector<SealKey> keys() override;

 private:
  void read();

  std::filesystem::path file_;
  std::function<Clock::time_point()> now_;
  std::mutex mutex_;
  std::vector<SealKey> keys_;
  std::filesystem::file_time_type written_;
  Clock::time_point looked_;
};

/// Keys in a state that servers share: a thread looks there every second, so that no vehicle waits
/// for a state that does not answer. While it is away, the keys that are known count. All servers
/// that reach the state know a new key before it seals: each counts from when it saw the key first,
/// so clocks may differ. Only a server that starts goes by its clock, for keys that are there.
/// What remains: a server that is cut off from the state does not learn the new key. What it seals
/// is refused by the others from a minute after they took the new key, until 5 s after it reaches
/// the state again; such sessions begin anew.
class StateSealKeys final : public SealKeySource {
 public:
  using Clock = std::chrono::system_clock;
  using Steady = std::chrono::steady_clock;

  /// Where the state has none yet, takes that of the file `seal.keys` in `store`, or makes one.
  /// @param table  outlives this. @param now, steady  for tests.
  /// @throws maps::InputError for a file without a key, StateAway, maps::StorageError.
  StateSealKeys(SealKeyTable& table, const std::filesystem::path& store,
                std::function<Clock::time_point()> now = Clock::now,
                std::function<Steady::time_point()> steady = Steady::now);

  [[nodiscard]] std::vector<SealKey> keys() override;

 private:
  /// @return whether there is any.
  bool read();
  void follow(const std::stop_token& stop);

  SealKeyTable& table_;
  std::function<Clock::time_point()> now_;
  std::function<Steady::time_point()> steady_;
  std::mutex mutex_;
  std::condition_variable_any stopping_;
  struct Known {
    SealKeyTable::Row row;
    Steady::time_point seen;
  };
  /// The newest first.
  std::vector<Known> known_;
  std::jthread thread_;  // last: it uses all of the above
};

/// The keys of a store, wherever it has them.
[[nodiscard]] std::unique_ptr<SealKeySource> seal_keys_of(PackageStore& store);

/// Puts a new key in front of the one that seals now. Servers of the store take it within a second.
/// @throws as `StoreSealKeys`, StateAway; maps::InputError when there is no key yet.
void rotate_seal_key(PackageStore& store);
/// The same in the file of a folder.
void rotate_seal_key(const std::filesystem::path& store);

}  // namespace stillmap::server
