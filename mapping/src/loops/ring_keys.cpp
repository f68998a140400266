#include "loops/ring_keys.hpp"

#include <algorithm>
#include <limits>
#include <nanoflann.hpp>
#include <utility>

namespace stillmap::mapping {
/// What nanoflann reads the keys from.
struct RingKeyTable {
  std::vector<RingKey> keys;

  [[nodiscard]] std::size_t kdtree_get_point_count() const { return keys.size(); }
  [[nodiscard]] float kdtree_get_pt(std::size_t key, std::size_t ring) const {
    return keys[key][static_cast<Eigen::Index>(ring)];
  }
  template <typename Box>
  bool kdtree_get_bbox(Box& /*box*/) const {
    return false;
  }
};

namespace {

/// The nearest so many of those that are allowed, in the form that nanoflann fills.
class Nearest {
 public:
  using DistanceType = float;

  Nearest(std::size_t count, const std::function<bool(std::size_t)>& allowed)
      : count_(count), allowed_(allowed) {}

  bool addPoint(float distance2, std::size_t index) {  // NOLINT(readability-identifier-naming)
    if (!allowed_(index)) return true;
    const std::pair<float, std::size_t> entry(distance2, index);
    if (full() && !(entry < found_.back())) return true;
    found_.insert(std::upper_bound(found_.begin(), found_.end(), entry), entry);
    if (found_.size() > count_) found_.pop_back();
    return true;
  }
  // NOLINTNEXTLINE(readability-identifier-naming)
  [[nodiscard]] float worstDist() const {
    // Equal ones must come too, or which of them is found hangs on the tree.
    return full() ? std::nextafter(found_.back().first, std::numeric_limits<float>::infinity())
                  : std::numeric_limits<float>::max();
  }
  [[nodiscard]] bool full() const { return found_.size() == count_; }
  [[nodiscard]] std::size_t size() const { return found_.size(); }
  [[nodiscard]] std::vector<std::size_t> indices() const {
    std::vector<std::size_t> out;
    for (const auto& [distance2, index] : found_) out.push_back(index);
    return out;
  }

 private:
  std::size_t count_;
  const std::function<bool(std::size_t)>& allowed_;
  std::vector<std::pair<float, std::size_t>> found_;
};

}  // namespace

struct RingKeys::Tree {
  using Index = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Adaptor<float, RingKeyTable>,
                                                    RingKeyTable, kContextRings, std::size_t>;
  explicit Tree(std::vector<RingKey> keys)
      : data{std::move(keys)}, index(kContextRings, data, {10}) {}

  RingKeyTable data;
  Index index;
};

RingKeys::RingKeys(std::vector<RingKey> keys)
    : tree_(std::make_unique<const Tree>(std::move(keys))) {}

RingKeys::~RingKeys() = default;

std::vector<std::size_t> RingKeys::nearest(const RingKey& key, std::size_t count,
                                           const std::function<bool(std::size_t)>& allowed) const {
  if (tree_->data.keys.empty() || count == 0) return {};
  Nearest found(count, allowed);
  tree_->index.findNeighbors(found, key.data(), nanoflann::SearchParams());
  return found.indices();
}

}  // namespace stillmap::mapping
