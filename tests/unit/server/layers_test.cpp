#include <gmock/gmock.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <thread>

#include "service_fixture.hpp"
#include "store/store_upkeep.hpp"

namespace stillmap::server {
namespace layers_test {

using nlohmann::json;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Key;
using ::testing::Not;
using ::testing::Pair;

/// Layers of `town`: tiles (-1, 0) with a point at (-0.75, 2.25, 3), and (0, 0) with two at (1.25,
/// 2.25, 3) and (4.25, 5.25, 6), each seen three times.
class Layers : public ServiceTest {
 protected:
  static constexpr const char* kCoverage = "/v1/maps/town/versions/v1/layers/coverage";

  /// Asked again until it is made.
  HttpResponse made(const std::string& path) const {
    HttpResponse response = get(path);
    while (response.status == 503 && body(response)["code"] == "BeingMade") {
      EXPECT_THAT(response.headers, Contains(Key("Retry-After")));
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      response = get(path);
    }
    return response;
  }
  static std::vector<float> floats(const HttpResponse& response) {
    EXPECT_EQ(response.content_type, "application/octet-stream");
    std::vector<float> values(response.body.size() / sizeof(float));
    std::memcpy(values.data(), response.body.data(), response.body.size());
    return values;
  }
  std::filesystem::path file() const { return store_.package() / "layers" / "coverage.layer"; }
  test::TemporaryFolder other_;
};

TEST_F(Layers, CoverageIsMadeOnceAndKept) {
  start();
  const HttpResponse response = made(kCoverage);
  ASSERT_EQ(response.status, 200) << response.body;
  EXPECT_THAT(response.headers, Contains(Pair("Cache-Control", HasSubstr("immutable"))));
  const json layer = body(response);
  EXPECT_EQ(layer["layer"], "coverage");
  EXPECT_EQ(layer["tile_size_m"], 20.0);
  EXPECT_EQ(layer["cell_m"], 1.0);
  EXPECT_EQ(layer["cells_per_side"], 20);
  EXPECT_EQ(layer["origin"], (json{100.0, 200.0, 0.0}));
  EXPECT_EQ(layer["tiles"], (json{{-1, 0}, {0, 0}}));
  ASSERT_EQ(layer["bands"].size(), 2U);
  const json& observations = layer["bands"][1];
  EXPECT_EQ(observations["name"], "observations");
  EXPECT_EQ(observations["min"], 3.0);
  EXPECT_EQ(observations["max"], 3.0);
  const std::vector<float> values = floats(get(observations["url"]));
  ASSERT_EQ(values.size(), 800U);
  EXPECT_EQ(values[2 * 20 + 19], 3.0F);
  EXPECT_EQ(values[400 + 2 * 20 + 1], 3.0F);
  EXPECT_EQ(values[400 + 5 * 20 + 4], 3.0F);
  EXPECT_TRUE(std::isnan(values[0]));
  EXPECT_NEAR(floats(get(layer["bands"][0]["url"]))[2 * 20 + 19], 3.0, test::kOffByStepsM);

  HttpRequest again = request("GET", kCoverage);
  for (const auto& [name, value] : response.headers)
    if (name == "ETag") again.headers["if-none-match"] = value;
  EXPECT_EQ(service_->handle(again).status, 304);
  EXPECT_TRUE(std::filesystem::exists(file()));
  EXPECT_TRUE(verify_store(store_.open()).empty()) << "it is no part of the package";
  // The next server finds it.
  service_.reset();
  start();
  EXPECT_EQ(get(kCoverage).status, 200);
}

TEST_F(Layers, DamagedFileIsMadeAnew) {
  start();
  const std::string good = made(kCoverage).body;
  service_.reset();
  std::ofstream(file(), std::ios::binary) << std::string(500, 'x');
  start();
  EXPECT_EQ(get(kCoverage).status, 503);
  EXPECT_EQ(made(kCoverage).body, good);
}

TEST_F(Layers, OfADamagedPackageAreNotMadeUntilItIsMended) {
  const std::filesystem::path sound = other_.path() / "sound";
  std::filesystem::copy(store_.package(), sound, std::filesystem::copy_options::recursive);
  // The height of the tile.
  const std::string pack = test::pack_of(store_.package());
  std::fstream(store_.package() / pack, std::ios::in | std::ios::out | std::ios::binary)
      .seekp(8)
      .write("\0\0\0\0", 4);
  start();
  const HttpResponse refused = made(kCoverage);
  EXPECT_EQ(body(refused)["code"], "DerivedUnavailable");
  EXPECT_THAT(refused.body, HasSubstr(pack + ", tile 0, 0: found SHA-256"));
  EXPECT_FALSE(std::filesystem::exists(file()));
  store_.open().add("town", "v1", sound);
  // Noticed within a second or two.
  HttpResponse height = made(std::string(kCoverage) + "/height");
  for (; height.status == 503; height = made(std::string(kCoverage) + "/height"))
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_NEAR(floats(height)[400 + 2 * 20 + 1], 3.0, test::kOffByStepsM);
  EXPECT_TRUE(std::filesystem::exists(file()));
}

TEST_F(Layers, IsServedWhereItCannotBeKept) {
  std::ofstream(store_.package() / "layers") << "a file is in the way";
  start();
  EXPECT_EQ(made(kCoverage).status, 200);
  EXPECT_EQ(get(kCoverage).status, 200);
}

TEST_F(Layers, WhatCannotBeMadeSaysWhy) {
  start();
  // Three points make no voxel.
  const std::string path = "/v1/maps/town/versions/v1/layers/localizability";
  HttpResponse response = get(path);
  while (body(response)["code"] == "BeingMade") {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    response = get(path);
  }
  EXPECT_EQ(response.status, 503);
  EXPECT_EQ(body(response)["code"], "DerivedUnavailable");
  EXPECT_THAT(response.headers, Contains(Key("Retry-After")));
  EXPECT_THAT(response.body, Not(HasSubstr(store_.folder().path().string())));
}

TEST_F(Layers, WhatIsNotThereIsNamed) {
  start();
  made(kCoverage);
  for (const char* path :
       {"/v1/maps/town/versions/v1/layers/colour", "/v1/maps/town/versions/v1/layers/colour/height",
        "/v1/maps/town/versions/v1/layers/coverage/scans"}) {
    EXPECT_EQ(get(path).status, 404) << path;
    EXPECT_EQ(body(get(path))["code"], "UnknownLayer") << path;
  }
  EXPECT_EQ(body(get("/v1/maps/town/versions/v9/layers/coverage"))["code"], "UnknownVersion");
  EXPECT_EQ(body(get("/v1/maps/nowhere/versions/v1/layers/coverage"))["code"], "UnknownMap");
}

}  // namespace layers_test
}  // namespace stillmap::server
