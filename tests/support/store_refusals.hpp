#pragma once

#include <gmock/gmock.h>
#include "store/store_refusal.hpp"

#include <functional>

namespace stillmap::test {

/// `change` is refused for this reason.
inline void expect_refused(server::StoreRefusal::Reason reason,
                           const std::function<void()>& change) {
  EXPECT_THAT(change, ::testing::Throws<server::StoreRefusal>(
                          ::testing::Property(&server::StoreRefusal::reason, reason)));
}

}  // namespace stillmap::test
