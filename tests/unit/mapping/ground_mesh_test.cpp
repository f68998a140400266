#include "evaluation/labels/ground_mesh.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <cstring>
#include <limits>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace ground_mesh_test {

using maps::InputError;
using test::ThrowsSaying;

/// A square of 10 m that rises by 0.1 m a metre along x, and a kerb's edge 0.12 m above it beyond
/// y = 10 m.
GroundMesh slope_with_kerb() {
  return {{{0, 0, 0},
           {10, 0, 1},
           {10, 10, 1},
           {0, 10, 0},
           {0, 10, 0.12F},
           {10, 10, 1.12F},
           {10, 15, 1.12F},
           {0, 15, 0.12F}},
          {{0, 1, 2}, {0, 2, 3}, {3, 2, 5}, {3, 5, 4}, {4, 5, 6}, {4, 6, 7}}};
}

TEST(GroundMesh, GivesTheHeightOnEveryTriangleAndItsEdges) {
  const GroundMesh mesh = slope_with_kerb();
  for (double x = 0.0; x <= 10.0; x += 0.25) {
    for (double y = 0.0; y < 9.99; y += 0.37) {
      ASSERT_TRUE(mesh.height(x, y)) << x << " " << y;
      EXPECT_NEAR(*mesh.height(x, y), 0.1 * x, 1e-6);
    }
    EXPECT_NEAR(mesh.height(x, 10.01).value(), 0.1 * x + 0.12, 1e-6);
  }
}

TEST(GroundMesh, TakesTheHighestOfSheetsOverEachOther) {
  const GroundMesh mesh(
      {{0, 0, 0}, {4, 0, 0}, {0, 4, 0}, {0, 0, 0.003F}, {4, 0, 0.003F}, {0, 4, 0.003F}},
      {{3, 4, 5}, {0, 1, 2}});
  EXPECT_NEAR(mesh.height(1.0, 1.0).value(), 0.003, 1e-6);
}

TEST(GroundMesh, KnowsNothingBesideItself) {
  const GroundMesh mesh = slope_with_kerb();
  EXPECT_FALSE(mesh.height(-0.1, 5.0));
  EXPECT_FALSE(mesh.height(5.0, 15.1));
  EXPECT_FALSE(mesh.height(1e9, 5.0));
  EXPECT_FALSE(mesh.height(std::numeric_limits<double>::quiet_NaN(), 5.0));
  EXPECT_FALSE(GroundMesh({}, {}).height(0.0, 0.0));
}

TEST(GroundMesh, RefusesWhatIsNoMesh) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(GroundMesh({{0, 0, nan}}, {}), std::invalid_argument);
  EXPECT_THROW(GroundMesh({{0, 0, 0}}, {{0, 0, 1}}), std::invalid_argument);
  EXPECT_THROW(GroundMesh({{0, 0, 0}, {60000, 0, 0}}, {{0, 0, 1}}), std::invalid_argument);
}

class ReadGroundMesh : public ::testing::Test {
 protected:
  static std::string header(int vertices, int faces) {
    return fmt::format(
        "ply\nformat binary_little_endian 1.0\ncomment ground in the map frame [m]\n"
        "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
        "element face {}\nproperty list uchar int vertex_indices\nproperty int label\nend_header\n",
        vertices, faces);
  }
  static std::string body(std::int32_t last_corner = 2) {
    const float vertices[9] = {0, 0, 1, 2, 0, 1, 0, 2, 3};
    const std::int32_t face[4] = {0, 1, last_corner, 40};
    std::string bytes(reinterpret_cast<const char*>(vertices), sizeof(vertices));
    bytes += '\3';
    bytes.append(reinterpret_cast<const char*>(face), sizeof(face));
    return bytes;
  }
  [[nodiscard]] GroundMesh read(const std::string& bytes) const {
    folder_.write("ground.ply", bytes);
    return read_ground_mesh(folder_.path() / "ground.ply");
  }
  test::TemporaryFolder folder_;
};

TEST_F(ReadGroundMesh, ReadsWhatTheSimulatorWrites) {
  const GroundMesh mesh = read(header(3, 1) + body());
  EXPECT_EQ(mesh.triangles(), 1U);
  EXPECT_NEAR(mesh.height(0.5, 1.0).value(), 2.0, 1e-6);
}

TEST_F(ReadGroundMesh, RefusesBrokenFilesByName) {
  const auto refuses = [&](const std::string& bytes, const std::string& word) {
    EXPECT_THAT([&] { (void)read(bytes); }, ThrowsSaying<InputError>({"ground.ply", word})) << word;
  };
  refuses("", "end_header");
  refuses("ply\nformat ascii 1.0\n", "format ascii 1.0");
  refuses(header(3, 1) + body().substr(1), "bytes after the header");
  refuses(header(3, 1) + body() + "x", "bytes after the header");
  refuses(header(-3, 1) + body(), "element vertex");
  refuses(header(2000000000, 1) + body(), "bytes after the header");
  refuses(header(3, 1) + body(3), "vertex 3");
  refuses(header(3, 1) + body(-1), "vertex -1");
  EXPECT_THROW((void)read_ground_mesh(folder_.path() / "none.ply"), maps::StorageError);
}

}  // namespace ground_mesh_test
}  // namespace stillmap::mapping
