#include "http/http_server.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <filesystem>
#include <thread>

#include "service_fixture.hpp"
#include "support/stored_packages.hpp"
#include "support/temporary_folder.hpp"

// After what brings in Eigen, see http_server.cpp.
#include <httplib.h>

namespace stillmap::server {
namespace delta_routes_test {

using ::testing::HasSubstr;
using ::testing::SizeIs;

/// A server with two versions of `yard` that share a tile.
class DeltaRoutesTest : public ServiceTest {
 protected:
  void SetUp() override {
    options_.port = 0;
    start();
    http_ = std::make_unique<HttpServer>(main_endpoint(options_), *service_, &service_->metrics());
    port_ = http_->bind();
    thread_ = std::thread([this] { http_->run(); });
    for (const int seed : {1, 2}) {
      const std::string name = std::to_string(seed);
      digests_.push_back(test::write_sharing_package(folder_.path() / name, seed));
      store_.open().add("yard", "v" + name, folder_.path() / name);
    }
  }
  void TearDown() override {
    http_->stop();
    thread_.join();
  }
  [[nodiscard]] httplib::Response get(const std::string& path,
                                      const httplib::Headers& headers = {}) const {
    auto result =
        httplib::Client("127.0.0.1", port_).Get("/v1/maps/yard/versions/" + path, headers);
    if (!result) throw std::runtime_error("no answer");
    return *result;
  }
  static std::string code(const httplib::Response& response) {
    return nlohmann::json::parse(response.body).at("code");
  }

  test::TemporaryFolder folder_;
  std::unique_ptr<HttpServer> http_;
  int port_ = 0;
  std::thread thread_;
  std::vector<std::string> digests_;
};

TEST_F(DeltaRoutesTest, ListsWhatIsMissing) {
  const auto answer = get("v2/delta?from=" + digests_[0]);
  ASSERT_EQ(answer.status, 200) << answer.body;
  const auto json = nlohmann::json::parse(answer.body);
  EXPECT_EQ(json.at("from"), digests_[0]);
  EXPECT_EQ(json.at("to"), digests_[1]);
  // Of the own tile its pack and the node of its region, and two files of equal bytes.
  EXPECT_THAT(json.at("missing"), SizeIs(4));
  std::uint64_t missing = 0;
  for (const auto& file : json.at("missing")) missing += file.at("bytes").get<std::uint64_t>();
  EXPECT_EQ(json.at("missing_bytes"), missing);
  EXPECT_LT(missing, json.at("bytes").get<std::uint64_t>());
  EXPECT_THAT(nlohmann::json::parse(get("v2/delta?from=" + digests_[1]).body).at("missing"),
              SizeIs(0));
}

TEST_F(DeltaRoutesTest, GivesEachFileByItsChecksumAndInParts) {
  const auto manifest = get("v2/files/" + digests_[1]);
  ASSERT_EQ(manifest.status, 200);
  EXPECT_EQ(maps::sha256_of(manifest.body), digests_[1]);
  const auto json = nlohmann::json::parse(get("v2/delta?from=" + digests_[0]).body);
  for (const auto& file : json.at("missing")) {
    const std::string sha256 = file.at("sha256");
    const auto whole = get("v2/files/" + sha256);
    EXPECT_EQ(whole.status, 200);
    EXPECT_EQ(whole.get_header_value("ETag"), '"' + sha256 + '"');
    EXPECT_EQ(maps::sha256_of(whole.body), sha256);
    const std::size_t half = whole.body.size() / 2;
    const auto rest = get("v2/files/" + sha256, {{"Range", fmt::format("bytes={}-", half)}});
    EXPECT_EQ(rest.status, 206);
    EXPECT_EQ(rest.body, whole.body.substr(half));
  }
  EXPECT_EQ(get("v2/files/" + digests_[1], {{"If-None-Match", '"' + digests_[1] + '"'}}).status,
            304);
}

TEST_F(DeltaRoutesTest, GivesWhatIsMissingAsATar) {
  const auto whole = get("v2/content"), delta = get("v2/content?from=" + digests_[0]);
  ASSERT_EQ(delta.status, 200);
  EXPECT_LT(delta.body.size(), 0.7 * static_cast<double>(whole.body.size()));
  EXPECT_NE(delta.get_header_value("ETag"), whole.get_header_value("ETag"));
  const auto put = httplib::Client("127.0.0.1", port_)
                       .Put("/v1/maps/yard/versions/v3", delta.body, "application/x-tar");
  EXPECT_EQ(put->status, 201) << put->body;
  EXPECT_EQ(nlohmann::json::parse(put->body).at("digest"), digests_[1]);
}

TEST_F(DeltaRoutesTest, RefusesWhatItDoesNotHave) {
  EXPECT_EQ(get("v2/delta").status, 400);
  EXPECT_EQ(get("v2/delta?from=1").status, 400);
  const auto unknown = get("v2/delta?from=" + std::string(64, '0'));
  EXPECT_EQ(unknown.status, 404);
  EXPECT_EQ(code(unknown), "UnknownVersion");
  EXPECT_THAT(unknown.body, HasSubstr("ask for the whole version"));
  EXPECT_EQ(get("v2/content?from=" + std::string(64, '0')).status, 404);
  EXPECT_EQ(get("v2/files/" + digests_[0]).status, 404);
  EXPECT_EQ(get("v2/files/x").status, 404);
  // A damaged file is never served.
  const auto package = store_.folder().path() / "packages" / digests_[1];
  std::filesystem::resize_file(package / test::pack_of(package, test::kOwnTile), 0);
  EXPECT_GE(get("v2/files/" + digests_[1]).status, 500);
}

}  // namespace delta_routes_test
}  // namespace stillmap::server
