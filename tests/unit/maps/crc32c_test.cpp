#include <stillmap/maps/crc32c.hpp>

#include <gtest/gtest.h>

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace stillmap::maps {
namespace crc32c_test {

TEST(Crc32c, IsCastagnolis) {
  const std::string text = "123456789";
  const auto bytes = std::as_bytes(std::span(text));
  EXPECT_EQ(crc32c(bytes), 0xE3069283U);
  for (std::size_t cut = 0; cut <= text.size(); ++cut) {
    EXPECT_EQ(crc32c(bytes.subspan(cut), crc32c(bytes.first(cut))), 0xE3069283U) << cut;
  }
  // RFC 3720, B.4: 32 bytes of zeros.
  EXPECT_EQ(crc32c(std::vector<std::byte>(32)), 0x8A9136AAU);
}

}  // namespace crc32c_test
}  // namespace stillmap::maps
