#pragma once

#include "loops/scan_context.hpp"

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

namespace stillmap::mapping {

/// Places by their ring keys, in a kd-tree (nanoflann).
class RingKeys {
 public:
  explicit RingKeys(std::vector<RingKey> keys);
  ~RingKeys();
  RingKeys(const RingKeys&) = delete;
  RingKeys& operator=(const RingKeys&) = delete;

  /// Those nearest to `key` among the ones that are allowed, nearest first, the lowest number of
  /// equal ones. Safe from several threads.
  [[nodiscard]] std::vector<std::size_t> nearest(
      const RingKey& key, std::size_t count, const std::function<bool(std::size_t)>& allowed) const;

 private:
  struct Tree;
  std::unique_ptr<const Tree> tree_;
};

}  // namespace stillmap::mapping
