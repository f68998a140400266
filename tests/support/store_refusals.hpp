#pragma once

#include <gmock/gmock.h>
#include <stillmap/maps/store/store_refusal.hpp>

#include <functional>

namespace stillmap::test {

/// `change` is refused for this reason.
inline void expect_refused(maps::StoreRefusal::Reason reason, const std::function<void()>& change) {
  EXPECT_THAT(change, ::testing::Throws<maps::StoreRefusal>(
                          ::testing::Property(&maps::StoreRefusal::reason, reason)));
}

}  // namespace stillmap::test
