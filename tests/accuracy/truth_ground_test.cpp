#include "accuracy/truth_ground.hpp"

#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace stillmap::test {
namespace {

template <typename T>
void append(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// A slope z = 0.1 x over [0, 10] x [0, 10] in one triangle, and a deck at 5 m above it.
std::string ply(const std::vector<std::int32_t>& indices) {
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\nelement vertex 6\nproperty float x\n"
      "property float y\nproperty float z\nelement face 2\n"
      "property list uchar int vertex_indices\nproperty int label\nend_header\n";
  for (const float z : {0.0F, 5.0F}) {
    for (const auto& p : {std::array{0.0F, 0.0F, z}, std::array{10.0F, 0.0F, z > 0 ? z : 1.0F},
                          std::array{0.0F, 10.0F, z}}) {
      for (const float coordinate : p) append(bytes, coordinate);
    }
  }
  for (std::size_t face = 0; face < 2; ++face) {
    append(bytes, std::uint8_t{3});
    for (std::size_t k = 0; k < 3; ++k) append(bytes, indices[3 * face + k]);
    append(bytes, std::int32_t{40});
  }
  return bytes;
}

class TruthGroundFile : public testing::Test {
 protected:
  std::filesystem::path write(const std::string& bytes) {
    std::ofstream(file_, std::ios::binary) << bytes;
    return file_;
  }
  void TearDown() override { std::filesystem::remove(file_); }

 private:
  std::filesystem::path file_ =
      std::filesystem::path(testing::TempDir()) /
      (std::string("truth_") + testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST_F(TruthGroundFile, GivesTheLayerNearestToThePlace) {
  const TruthGround truth = TruthGround::read(write(ply({0, 1, 2, 3, 4, 5})));
  EXPECT_NEAR(truth.height_at({4.0, 3.0, 1.0}).value(), 0.4, 1e-6);
  EXPECT_NEAR(truth.height_at({4.0, 3.0, 4.0}).value(), 5.0, 1e-6);
  EXPECT_FALSE(truth.height_at({6.0, 6.0, 0.0}));
  EXPECT_FALSE(truth.height_at({-1.0, 3.0, 0.0}));
}

TEST_F(TruthGroundFile, IsRefusedShortOrWithIndicesOutOfRange) {
  const std::string whole = ply({0, 1, 2, 3, 4, 5});
  EXPECT_THROW((void)TruthGround::read(write(whole.substr(0, whole.size() - 1))), maps::InputError);
  EXPECT_THROW((void)TruthGround::read(write(ply({0, 1, 6, 3, 4, 5}))), maps::InputError);
  EXPECT_THROW((void)TruthGround::read(write("ply\nend_header\n")), maps::InputError);
}

}  // namespace
}  // namespace stillmap::test
