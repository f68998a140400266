#include "http/content_digest.hpp"
#include "http/http_server.hpp"

#include <gmock/gmock.h>
#include <openssl/sha.h>

#include <filesystem>
#include <fstream>
#include <thread>
#include <vector>

#include "body_in_memory.hpp"
#include "raw_client.hpp"
#include "service_fixture.hpp"
#include "store/store_upkeep.hpp"
#include "support/store_contents.hpp"
#include "support/stored_packages.hpp"

// After what brings in Eigen, see http_server.cpp.
#include <httplib.h>

namespace stillmap::server {
namespace package_routes_test {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::SizeIs;

std::string sha256_of(const std::string& bytes) {
  std::array<unsigned char, SHA256_DIGEST_LENGTH> hash{};
  SHA256(reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size(), hash.data());
  std::string hex;
  for (const unsigned char byte : hash) {
    hex += "0123456789abcdef"[byte >> 4U];
    hex += "0123456789abcdef"[byte & 15U];
  }
  return hex;
}

/// A server over `town` with v1 active, on a free port, to which packages are sent.
class PackageRoutesTest : public ServiceTest {
 protected:
  void SetUp() override {
    options_.port = 0;
    options_.uploads.max_package_bytes = 1 << 20;
    start();
    http_ = std::make_unique<HttpServer>(main_endpoint(options_), *service_, &service_->metrics());
    port_ = http_->bind();
    thread_ = std::thread([this] { http_->run(); });
    digest_ = test::write_package(folder_.path() / "new", 7);
    tar_ = test::tar_of(folder_.path() / "new", "") + test::tar_end();
  }
  void TearDown() override {
    http_->stop();
    thread_.join();
  }

  httplib::Client client() const { return httplib::Client("127.0.0.1", port_); }
  httplib::Response put(const std::string& version, const std::string& bytes,
                        const httplib::Headers& headers = {},
                        const std::string& type = "application/x-tar") const {
    auto result = client().Put("/v1/maps/town/versions/" + version, headers, bytes, type);
    if (!result) throw std::runtime_error("no answer");
    return *result;
  }
  httplib::Response post(const std::string& path, const httplib::Headers& headers = {}) const {
    auto result = client().Post("/v1/maps/town/" + path, headers, "", "application/json");
    if (!result) throw std::runtime_error("no answer");
    return *result;
  }
  static std::string code(const httplib::Response& response) {
    return nlohmann::json::parse(response.body).at("code");
  }
  nlohmann::json listed() const {
    return nlohmann::json::parse(client().Get("/v1/maps/town/versions")->body);
  }
  /// Folders of packages in the store, whatever they are called.
  std::ptrdiff_t packages() const {
    const std::filesystem::directory_iterator each(store_.folder().path() / "packages");
    return std::distance(begin(each), end(each));
  }

  test::TemporaryFolder folder_{test::memory_folder()};
  std::string tar_, digest_;
  std::unique_ptr<HttpServer> http_;
  int port_ = 0;
  std::thread thread_;
};

TEST_F(PackageRoutesTest, UploadBecomesAVersionOnce) {
  const httplib::Headers right = {{"Content-Digest", content_digest_of(sha256_of(tar_))}};
  const httplib::Response made = put("v2", tar_, right);
  EXPECT_EQ(made.status, 201) << made.body;
  EXPECT_EQ(made.get_header_value("Location"), "/v1/maps/town/versions/v2");
  EXPECT_EQ(nlohmann::json::parse(made.body)["digest"], digest_);
  EXPECT_EQ(put("v2", tar_).status, 200);
  EXPECT_EQ(put("v3", tar_).status, 201);
  EXPECT_THAT(listed()["versions"], SizeIs(3));
  EXPECT_EQ(packages(), 2);
  EXPECT_TRUE(verify_store(store_.open()).empty());
}

TEST_F(PackageRoutesTest, DamagedBytesAreNeverSentAndMendedOnesAre) {
  ASSERT_EQ(put("v2", tar_).status, 201);
  const std::filesystem::path package = store_.folder().path() / "packages" / digest_;
  const std::string content = "/v1/maps/town/versions/v2/content";
  const auto refused = [&](const httplib::Headers& headers) {
    const auto answer = client().Get(content.c_str(), headers);
    return answer->status == 500 && code(*answer) == "StorageError" &&
           answer->body.find("version 'v2' of map 'town'") != std::string::npos &&
           answer->body.find("add the same package again") != std::string::npos;
  };
  const auto flip_a_bit = [&] {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(package / "packs")) {
      if (!entry.is_regular_file()) continue;
      std::fstream file(entry.path(), std::ios::in | std::ios::out | std::ios::binary);
      file.seekg(9);
      const char was = static_cast<char>(file.get());
      file.seekp(9);
      file.put(static_cast<char>(was ^ 1));
      return;
    }
  };
  flip_a_bit();
  EXPECT_TRUE(refused({}));
  EXPECT_TRUE(refused({{"Range", "bytes=0-99"}})) << "a part that is whole belongs to no package";
  EXPECT_EQ(put("v2", tar_).status, 200);
  EXPECT_EQ(client().Get(content.c_str())->status, 200) << "mended by publishing it again";
  EXPECT_EQ(client().Get(content.c_str(), {{"Range", "bytes=0-99"}})->status, 206);
  flip_a_bit();
  EXPECT_TRUE(refused({})) << "though it was whole when it was sent before";
}

TEST_F(PackageRoutesTest, ADamagedPreviewIsNotSent) {
  const std::filesystem::path built = folder_.path() / "drawn";
  maps::MapPackageWriter writer(built);
  writer.add_tile({}, std::vector<maps::MapPoint>(1));
  std::ofstream(writer.folder() / "preview.png") << "a picture";
  maps::MapManifest manifest;
  manifest.frame_id = "map";
  const std::string digest = writer.publish(manifest, "{}");
  ASSERT_EQ(put("v2", test::tar_of(built, "") + test::tar_end()).status, 201);
  const auto ask = [&] { return client().Get("/v1/maps/town/versions/v2/preview"); };
  EXPECT_EQ(ask()->body, "a picture");
  std::ofstream(store_.folder().path() / "packages" / digest / "preview.png") << "a pictura";
  EXPECT_EQ(ask()->status, 500);
  EXPECT_EQ(code(*ask()), "StorageError");
}

TEST_F(PackageRoutesTest, AnotherPackageUnderAKnownNameIsRefused) {
  const httplib::Response refused = put("v1", tar_);
  EXPECT_EQ(refused.status, 409);
  EXPECT_EQ(code(refused), "OtherDigest");
  EXPECT_EQ(listed()["versions"][0]["digest"], store_.digest());
  // The name of a removed version means what it meant.
  EXPECT_EQ(put("v2", tar_).status, 201);
  EXPECT_EQ(client().Delete("/v1/maps/town/versions/v2")->status, 204);
  test::write_package(folder_.path() / "other", 8);
  EXPECT_EQ(put("v2", test::tar_of(folder_.path() / "other", "") + test::tar_end()).status, 409);
  EXPECT_EQ(put("v2", tar_).status, 201);
}

TEST_F(PackageRoutesTest, WrongDigestLeavesNothing) {
  const httplib::Response refused =
      put("v2", tar_, {{"Content-Digest", content_digest_of(sha256_of(tar_ + "x"))}});
  EXPECT_EQ(refused.status, 422);
  EXPECT_EQ(code(refused), "InvalidUpload");
  EXPECT_THAT(refused.body, HasSubstr(sha256_of(tar_)));
  for (const char* unreadable : {"sha-256", "sha-256=::", "md5=:abc=:",
                                 "sha-256=:!!!!aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa=:"}) {
    const httplib::Response bad = put("v2", tar_, {{"Content-Digest", unreadable}});
    EXPECT_EQ(bad.status, 400) << unreadable;
  }
  EXPECT_THAT(listed()["versions"], SizeIs(1));
  EXPECT_EQ(packages(), 1);
}

TEST_F(PackageRoutesTest, WhatIsNoPackageIsSaidAndLeavesNothing) {
  EXPECT_EQ(code(put("v2", "no tar")), "InvalidUpload");
  EXPECT_EQ(code(put("v2", "")), "InvalidUpload");
  EXPECT_EQ(code(put("v2", tar_.substr(0, tar_.size() / 2))), "InvalidUpload");
  EXPECT_EQ(code(put("v2", test::tar_file("../a", "x") + tar_)), "InvalidUpload");
  std::string bent = tar_;
  // Deep in the points of its only tile.
  bent[bent.rfind("packs/") + 1000] ^= 1;
  EXPECT_EQ(code(put("v2", bent)), "InvalidUpload");
  EXPECT_EQ(code(put("V2", tar_)), "InvalidRequest");
  EXPECT_EQ(put("v2", tar_, {}, "application/json").status, 415);
  EXPECT_EQ(put("v2", std::string((1 << 20) + 1, 'x')).status, 413);
  EXPECT_EQ(packages(), 1);
  EXPECT_THAT(put("v2", tar_.substr(0, 5000)).body,
              Not(HasSubstr(store_.folder().path().string())));
}

TEST_F(PackageRoutesTest, UploadThatBreaksOffLeavesNothing) {
  RawClient broken(port_);
  broken.send("PUT /v1/maps/town/versions/v2 HTTP/1.1\r\nHost: localhost\r\nContent-Length: " +
              std::to_string(tar_.size()) + "\r\n\r\n" + tar_.substr(0, tar_.size() / 2));
  broken.close_sending();
  EXPECT_THAT(broken.read_to_end(), Not(HasSubstr("201")));
  EXPECT_THAT(listed()["versions"], SizeIs(1));
  EXPECT_EQ(packages(), 1);
}

TEST_F(PackageRoutesTest, ContentComesBackWholeOrInPartsAndIsTheSamePackage) {
  put("v2", tar_);
  const std::string path = "/v1/maps/town/versions/v2/content";
  const auto whole = client().Get(path);
  ASSERT_EQ(whole->status, 200);
  EXPECT_THAT(whole->get_header_value("Cache-Control"),
              ::testing::AllOf(HasSubstr("private"), HasSubstr("immutable")));
  const auto part = client().Get(path, {{"Range", "bytes=512-1023"}});
  EXPECT_EQ(part->status, 206);
  EXPECT_EQ(part->body, whole->body.substr(512, 512));
  EXPECT_EQ(part->get_header_value("Content-Range"),
            "bytes 512-1023/" + std::to_string(whole->body.size()));
  const auto end = client().Get(path, {{"Range", "bytes=-1024"}});
  EXPECT_EQ(end->body, whole->body.substr(whole->body.size() - 1024));
  EXPECT_EQ(client().Get(path, {{"Range", "bytes=0-0,2-2"}})->status, 416);
  EXPECT_EQ(client().Get(path, {{"Range", "bytes=999999999-"}})->status, 416);
  const std::string etag = whole->get_header_value("ETag");
  EXPECT_EQ(client().Get(path, {{"If-None-Match", etag}})->status, 304);
  EXPECT_EQ(nlohmann::json::parse(put("v3", whole->body).body)["digest"], digest_);
}

TEST_F(PackageRoutesTest, ActivatedVersionIsServedAndTheOldOneMayGo) {
  put("v2", tar_);
  EXPECT_EQ(code(post("versions/v2/activate")), "OtherFrame");
  const httplib::Response active = post("versions/v2/activate?new_frame=true");
  EXPECT_EQ(active.status, 200) << active.body;
  EXPECT_EQ(active.get_header_value("ETag"), "\"2\"");
  const auto pose = client().Post("/v1/maps/town/localize?prior_t=1,2,3&prior_q=0,0,0,1",
                                  raw_scan(60), "application/octet-stream");
  EXPECT_EQ(nlohmann::json::parse(pose->body)["map"]["version"], "v2");
  const auto kept = client().Delete("/v1/maps/town/versions/v2");
  EXPECT_EQ(kept->status, 409);
  EXPECT_EQ(code(*kept), "VersionActive");
  EXPECT_EQ(client().Delete("/v1/maps/town/versions/v1")->status, 204);
  EXPECT_EQ(client().Delete("/v1/maps/town/versions/v1")->status, 404);
  EXPECT_EQ(client().Get("/v1/maps/town/versions/v1/objects")->status, 404);
  EXPECT_EQ(packages(), 1);
  EXPECT_EQ(code(post("rollback")), "NoPrevious");
}

TEST_F(PackageRoutesTest, ChangeOfTheActiveVersionMayAskForARevision) {
  put("v2", tar_);
  const std::string activate = "versions/v2/activate?new_frame=true";
  const httplib::Response stale = post(activate, {{"If-Match", "\"7\""}});
  EXPECT_EQ(stale.status, 412);
  EXPECT_EQ(code(stale), "RevisionChanged");
  for (const char* unreadable : {"7", "\"\"", "\"x\"", "\"-1\"", "W/\"1\"", "\"1\", \"2\""})
    EXPECT_EQ(post(activate, {{"If-Match", unreadable}}).status, 400) << unreadable;
  EXPECT_EQ(post(activate, {{"If-Match", "\"1\""}}).status, 200);
  const httplib::Response back = post("rollback?new_frame=true", {{"If-Match", "\"2\""}});
  EXPECT_EQ(back.status, 200) << back.body;
  EXPECT_EQ(back.get_header_value("ETag"), "\"3\"");
  EXPECT_EQ(listed()["version"], "v1");
  EXPECT_EQ(code(post("versions/v2/activate?newframe=true")), "UnknownParameter");
  EXPECT_EQ(code(post("versions/v2/activate?new_frame=1")), "InvalidRequest");
  EXPECT_EQ(code(post("versions/v9/activate")), "UnknownVersion");
}

}  // namespace package_routes_test
}  // namespace stillmap::server
