#pragma once

#include "views/range_view.hpp"

#include <stillmap/maps/scratch_file.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <list>
#include <memory>
#include <mutex>
#include <vector>

namespace stillmap::mapping {

/// The range views of all scans of a build, in a scratch file: memory holds 16 bytes a scan and the
/// views that were read last.
class RangeViewStore {
 public:
  /// Makes a scratch file of its own in `folder`; it is removed with the store.
  /// @throws maps::StorageError naming the file.
  explicit RangeViewStore(const std::filesystem::path& folder);

  /// Gives the next ordinal to a view. Not while another thread is in any other function.
  /// @throws maps::StorageError naming the file, e.g. on a full disk; the store is unchanged then.
  void append(const RangeView& view);

  [[nodiscard]] std::size_t size() const { return places_.size(); }
  [[nodiscard]] const std::filesystem::path& file() const { return file_.path(); }

  /// Safe from several threads.
  /// @throws std::out_of_range; maps::StorageError naming the file when it cannot be read, ends too
  /// early or holds something else.
  [[nodiscard]] std::shared_ptr<const RangeView> read(std::size_t ordinal) const;

 private:
  struct Place {
    std::uint64_t offset = 0;
    std::uint64_t bytes = 0;
  };
  struct Cached {
    std::size_t ordinal;
    std::shared_ptr<const RangeView> view;
  };
  [[nodiscard]] std::shared_ptr<const RangeView> cached(std::size_t ordinal) const;
  void remember(std::size_t ordinal, const std::shared_ptr<const RangeView>& view) const;
  [[nodiscard]] RangeView load(const Place& place) const;

  maps::ScratchFile file_;
  std::vector<Place> places_;
  mutable std::mutex mutex_;
  mutable std::list<Cached> cache_;  ///< the one used last in front
};

}  // namespace stillmap::mapping
