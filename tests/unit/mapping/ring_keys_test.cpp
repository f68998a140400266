#include "loops/ring_keys.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace ring_keys_test {

using testing::ElementsAre;
using testing::IsEmpty;

std::vector<RingKey> random_keys(std::size_t count) {
  test::Random random(1);
  std::vector<RingKey> keys(count);
  for (RingKey& key : keys) {
    for (float& value : key.reshaped()) value = static_cast<float>(random.uniform());
  }
  return keys;
}

TEST(RingKeys, FindsTheNearestOfThoseAllowed) {
  const std::vector<RingKey> keys = random_keys(500);
  const RingKeys tree(keys);
  const auto allowed = [](std::size_t i) { return i % 3 == 0 && i < 400; };
  for (const std::size_t query : {0U, 123U, 499U}) {
    std::vector<std::pair<float, std::size_t>> all;
    for (std::size_t i = 0; i < keys.size(); ++i) {
      if (allowed(i)) all.emplace_back((keys[i] - keys[query]).squaredNorm(), i);
    }
    std::sort(all.begin(), all.end());
    std::vector<std::size_t> expected;
    for (std::size_t k = 0; k < 7; ++k) expected.push_back(all[k].second);
    EXPECT_EQ(tree.nearest(keys[query], 7, allowed), expected);
  }
}

TEST(RingKeys, TakesTheFirstOfEqualOnes) {
  std::vector<RingKey> keys(40, RingKey::Constant(1.0F));
  keys[30] = RingKey::Constant(1.1F);
  const RingKeys tree(keys);
  const auto later = [](std::size_t i) { return i >= 5; };
  EXPECT_THAT(tree.nearest(keys[0], 3, later), ElementsAre(5, 6, 7));
}

TEST(RingKeys, GivesWhatThereIs) {
  const RingKeys tree(random_keys(4));
  const RingKey key = RingKey::Zero();
  const auto any = [](std::size_t) { return true; };
  EXPECT_EQ(tree.nearest(key, 10, any).size(), 4U);
  EXPECT_THAT(tree.nearest(key, 10, [](std::size_t) { return false; }), IsEmpty());
  EXPECT_THAT(tree.nearest(key, 0, any), IsEmpty());
  EXPECT_THAT(RingKeys({}).nearest(key, 3, any), IsEmpty());
}

}  // namespace ring_keys_test
}  // namespace stillmap::mapping
