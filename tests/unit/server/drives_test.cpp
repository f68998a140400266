#include <gmock/gmock.h>

#include "body_in_memory.hpp"
#include "http/content_digest.hpp"
#include "service_fixture.hpp"
#include "support/bag_bytes.hpp"
#include "support/message_bytes.hpp"
#include "support/tar_bytes.hpp"

namespace stillmap::server {
namespace drives_test {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::Pair;

class Drives : public ServiceTest {
 protected:
  static constexpr const char* kDrives = "/v1/maps/town/drives";

  HttpResponse send(const std::string& method, const std::string& path,
                    const std::string& json = {}) const {
    HttpRequest asked = request(method, path);
    asked.headers["content-type"] = "application/json";
    asked.body = json;
    return service_->handle(asked);
  }
  HttpResponse put(const std::string& path, const std::string& bytes,
                   const std::string& digest = {}) const {
    HttpRequest asked = request("PUT", path);
    if (!digest.empty()) asked.headers["content-digest"] = digest;
    BodyInMemory stream(bytes);
    asked.stream = &stream;
    return service_->handle(asked);
  }
  /// @return its path.
  std::string open_one() const {
    const HttpResponse made = send("POST", kDrives, R"({"name": "monday"})");
    EXPECT_EQ(made.status, 201);
    return std::string(kDrives) + "/" + std::to_string(body(made)["id"].get<int>());
  }
  static std::string tar() {
    return test::tar_file("a/0.bin", std::string(64, '\x3f')) + test::tar_end();
  }
};

TEST_F(Drives, DriveIsOpenedFilledAndCompleted) {
  start();
  const HttpResponse made = send("POST", kDrives, R"({"name": "monday"})");
  EXPECT_EQ(made.status, 201);
  const std::string path = "/v1/maps/town/drives/1";
  EXPECT_THAT(made.headers, Contains(Pair("Location", path)));
  EXPECT_EQ(body(made)["status"], "open");
  const HttpResponse part = put(path + "/parts/2", tar().substr(700));
  EXPECT_EQ(part.status, 201);
  EXPECT_EQ(body(part)["n"], 2);
  EXPECT_EQ(put(path + "/parts/1", tar().substr(0, 700)).status, 201);
  EXPECT_EQ(put(path + "/parts/1", tar().substr(0, 700)).status, 200);
  nlohmann::json drive = body(get(path));
  EXPECT_EQ(drive["name"], "monday");
  EXPECT_EQ(drive["bytes"], tar().size());
  ASSERT_EQ(drive["parts"].size(), 2U);
  EXPECT_EQ(drive["parts"][0]["bytes"], 700);
  EXPECT_EQ(body(send("POST", path + "/complete"))["status"], "complete");
  EXPECT_EQ(send("POST", path + "/complete").status, 200);
  EXPECT_EQ(body(get(kDrives))["drives"][0]["status"], "complete");
  EXPECT_EQ(send("DELETE", path).status, 204);
  EXPECT_EQ(get(path).status, 404);
  EXPECT_TRUE(body(get(kDrives))["drives"].empty());
}

TEST_F(Drives, PartIsHeldAgainstItsDigestAndItsFormerSelf) {
  start();
  const std::string path = open_one() + "/parts/1";
  const std::string sha256 = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
  const HttpResponse damaged = put(path, "abd", content_digest_of(sha256));
  EXPECT_EQ(damaged.status, 422);
  EXPECT_EQ(body(damaged)["code"], "InvalidUpload");
  EXPECT_EQ(put(path, "abc", content_digest_of(sha256)).status, 201);
  const HttpResponse other = put(path, "abd");
  EXPECT_EQ(other.status, 409);
  EXPECT_EQ(body(other)["code"], "OtherDigest");
}

TEST_F(Drives, WhatIsNoDriveFailsWithoutNamingPlacesOfTheMachine) {
  start();
  const std::string path = open_one();
  EXPECT_EQ(body(send("POST", path + "/complete"))["code"], "PartsMissing");
  put(path + "/parts/1", test::tar_file("readme.txt", "x") + test::tar_end());
  const HttpResponse refused = send("POST", path + "/complete");
  EXPECT_EQ(refused.status, 422);
  EXPECT_EQ(body(refused)["code"], "InvalidUpload");
  nlohmann::json drive = body(get(path));
  EXPECT_EQ(drive["status"], "failed");
  EXPECT_THAT(drive["error"].get<std::string>(), HasSubstr("no layout"));
  for (const std::string& text : {refused.body, get(path).body, get(kDrives).body})
    EXPECT_THAT(text, Not(HasSubstr(store_.folder().path().string())));
  EXPECT_EQ(body(put(path + "/parts/2", "x"))["code"], "DriveNotOpen");
}

TEST_F(Drives, RecordingThatNeedsAChoiceIsKeptAndListsWhatCanBeChosen) {
  start();
  const std::string path = open_one();
  put(path + "/parts/1", test::tar_file("run.mcap", test::bag_of_two_clouds()) + test::tar_end());
  EXPECT_EQ(body(get(path))["inspection"], nullptr);
  const std::string complete = path + "/complete";
  for (const char* wrong : {R"({"choice": "lidar=/x"})", R"({"choice": ""})", R"({"choice": 1})",
                            R"({"choice": "cloud=/x\n"})"}) {
    EXPECT_EQ(body(send("POST", complete, wrong))["errors"][0]["path"], "choice") << wrong;
  }
  EXPECT_EQ(body(send("POST", complete, R"({"choice": "stamps=none"})"))["errors"][0]["expected"],
            "stamps=header or stamps=recorded");
  const HttpResponse asked = send("POST", complete);
  EXPECT_EQ(asked.status, 202);
  EXPECT_EQ(body(asked)["status"], "needs_choice");
  EXPECT_THAT(asked.body, Not(HasSubstr(store_.folder().path().string())));
  const nlohmann::json listed = body(get(kDrives))["drives"][0];
  EXPECT_THAT(listed["error"].get<std::string>(), HasSubstr("clouds on /cloud1"));
  ASSERT_EQ(listed["inspection"]["choices"].size(), 2U);
  EXPECT_EQ(listed["inspection"]["choices"][1]["choice"], "cloud=/cloud2");
  const HttpResponse rebuild = send("POST", "/v1/maps/town/rebuild",
                                    R"({"drives": [)" + path.substr(path.size() - 1) + "]}");
  EXPECT_EQ(body(rebuild)["code"], "DriveNotComplete");

  const HttpResponse wrong = send("POST", complete, R"({"choice": "cloud=/none"})");
  EXPECT_EQ(wrong.status, 202);
  EXPECT_THAT(body(wrong)["error"].get<std::string>(), HasSubstr("no clouds on /none"));
  const HttpResponse done = send("POST", complete, R"({"choice": "cloud=/cloud2"})");
  EXPECT_EQ(done.status, 200);
  EXPECT_EQ(body(done)["status"], "complete");
  EXPECT_EQ(body(done)["inspection"]["topic"], "/cloud2");
  EXPECT_TRUE(body(done)["inspection"]["choices"].empty());
  EXPECT_THAT(body(done)["inspection"]["findings"].dump(), HasSubstr("no_poses"));
  EXPECT_EQ(body(send("POST", complete, R"({"choice": "cloud=/cloud1"})"))["code"], "DriveNotOpen");
}

/// A sweep of an HDL-64E, whose lasers differ from sensor to sensor.
std::string bag_of_hdl64e() {
  std::string packet(1206, '\0');
  const std::string_view banks[] = {"\xff\xee", "\xff\xdd"};
  for (std::size_t block = 0; block < 12; ++block) packet.replace(100 * block, 2, banks[block % 2]);
  packet.replace(4, 2, "\x88\x13");
  test::MessageBytes scan;
  scan.header(1, "velodyne").put(std::uint32_t{1}).put(std::int32_t{0}).put(std::uint32_t{1});
  for (const char byte : packet) scan.put(byte);
  test::McapBytes bag;
  bag.add(test::McapBytes::schema(1, "velodyne_msgs/msg/VelodyneScan") +
          test::McapBytes::channel(1, 1, "/velodyne_packets") +
          test::McapBytes::message(1, scan.str()));
  return bag.finished();
}

TEST_F(Drives, RecordingWithoutItsCalibrationNeedsItAsAChoice) {
  start();
  const std::string path = open_one();
  std::string lasers;
  for (int laser = 0; laser < 64; ++laser)
    lasers += "- laser_id: " + std::to_string(laser) + "\n  vert_correction: 0.1\n";
  put(path + "/parts/1", test::tar_file("run.mcap", bag_of_hdl64e()) +
                             test::tar_file("64e.yaml", lasers) + test::tar_end());
  const HttpResponse asked = send("POST", path + "/complete");
  EXPECT_EQ(asked.status, 202);
  EXPECT_THAT(body(asked)["error"].get<std::string>(), HasSubstr("calibration of 64 lasers"));
  EXPECT_EQ(body(asked)["inspection"]["choices"][0]["choice"], "cloud=/velodyne_packets");
  const HttpResponse done =
      send("POST", path + "/complete", R"({"choice": "calibration=64e.yaml"})");
  EXPECT_EQ(body(done)["status"], "complete") << done.body;
  EXPECT_THAT(body(done)["inspection"]["findings"].dump(), Not(HasSubstr("unreadable")));
}

TEST_F(Drives, DriveWhoseScansCannotBeReadSaysSo) {
  start();
  const std::string path = open_one();
  put(path + "/parts/1", test::tar_file("run.pcd", "VERSION .7\nFIELDS x y\n") + test::tar_end());
  const HttpResponse done = send("POST", path + "/complete");
  EXPECT_EQ(body(done)["status"], "complete");
  const nlohmann::json inspection = body(done)["inspection"];
  EXPECT_EQ(inspection["scans"], 1);
  EXPECT_EQ(inspection["findings"][0]["code"], "unreadable");
  EXPECT_THAT(inspection["findings"][0]["what"].get<std::string>(), HasSubstr("run.pcd"));
  EXPECT_THAT(done.body, Not(HasSubstr(store_.folder().path().string())));
}

TEST_F(Drives, ScansOfMoreThanTheMostPointsAreNotInspected) {
  options_.min_scan_points = options_.max_scan_points = 3;
  start();
  const std::string path = open_one();
  put(path + "/parts/1", tar());
  const nlohmann::json drive = body(send("POST", path + "/complete"));
  EXPECT_EQ(drive["status"], "complete");
  EXPECT_THAT(drive["inspection"]["findings"].dump(), HasSubstr("expected at most 3"));
}

TEST_F(Drives, ChoiceOfWhatIsNoRecordingIsRefusedAndLosesNothing) {
  start();
  const std::string path = open_one();
  put(path + "/parts/1", tar());
  const HttpResponse refused = send("POST", path + "/complete", R"({"choice": "cloud=/points"})");
  EXPECT_EQ(refused.status, 422);
  EXPECT_THAT(body(refused)["detail"].get<std::string>(), HasSubstr("leave it out"));
  EXPECT_EQ(body(get(path))["status"], "open");
  EXPECT_EQ(body(send("POST", path + "/complete"))["status"], "complete");
}

TEST_F(Drives, BelongToTheirMap) {
  start();
  store_.open().create_map("village");
  open_one();
  for (const char* path :
       {"/v1/maps/village/drives/1", "/v1/maps/town/drives/2", "/v1/maps/town/drives/01",
        "/v1/maps/town/drives/-1", "/v1/maps/town/drives/99999999999999999999"}) {
    EXPECT_EQ(body(get(path))["code"], "UnknownDrive") << path;
    EXPECT_EQ(send("DELETE", path).status, 404) << path;
    EXPECT_EQ(put(std::string(path) + "/parts/1", "x").status, 404) << path;
    EXPECT_EQ(send("POST", std::string(path) + "/complete").status, 404) << path;
  }
  EXPECT_EQ(body(send("POST", "/v1/maps/hamlet/drives"))["code"], "UnknownMap");
  EXPECT_EQ(body(get("/v1/maps/hamlet/drives"))["code"], "UnknownMap");
}

TEST_F(Drives, BadRequestsAreRefusedByField) {
  start();
  const std::string path = open_one();
  EXPECT_EQ(body(send("POST", kDrives, R"({"nam": "x"})"))["code"], "UnknownParameter");
  EXPECT_EQ(body(send("POST", kDrives, R"({"name": 7})"))["errors"][0]["path"], "name");
  EXPECT_EQ(send("POST", kDrives, R"({"name": "a\nb"})").status, 400);
  EXPECT_EQ(send("POST", kDrives, "{\"name\": \"" + std::string(201, 'a') + "\"}").status, 400);
  for (const char* part : {"0", "10001", "x", "-1", "1x"})
    EXPECT_EQ(put(path + "/parts/" + part, "x").status, 400) << part;
  EXPECT_EQ(put(path + "/parts/1", "x", "sha-256=:no:").status, 400);
}

TEST_F(Drives, SizeOfOneDriveIsBounded) {
  options_.uploads.max_drive_bytes = 1 << 20;
  start();
  const std::string path = open_one();
  EXPECT_EQ(put(path + "/parts/1", std::string(1 << 20, 'a')).status, 201);
  EXPECT_EQ(put(path + "/parts/2", "b").status, 413);
  EXPECT_EQ(put(path + "/parts/1", std::string(1 << 20, 'a')).status, 200);
}

TEST_F(Drives, OneFileOfItMayBeAsLargeAsTheDrive) {
  start();
  const std::string path = open_one();
  // 20 GiB, of which little comes.
  std::string size(12, '\0');
  size[0] = '\x80';
  size[7] = 5;
  put(path + "/parts/1",
      test::tar_block({.name = "run.mcap", .size_field = size}) + std::string(600, '\x3f'));
  const HttpResponse refused = send("POST", path + "/complete");
  EXPECT_EQ(refused.status, 422);
  EXPECT_THAT(refused.body, Not(HasSubstr("at most")));
}

TEST_F(Drives, UploadsBeyondTheBoundAreSentAway) {
  options_.uploads.max_open = 1;
  start();
  HttpRequest first = request("PUT", open_one() + "/parts/1");
  HttpRequest second = first;
  const Router::Match match = service_->admit(first);
  try {
    static_cast<void>(service_->admit(second));
    FAIL() << "a second upload was admitted";
  } catch (const ApiError& error) {
    EXPECT_EQ(error.code(), ErrorCode::kBusy);
    EXPECT_THAT(error.headers(), Contains(Pair("Retry-After", "5")));
  }
  first.reservation.reset();
  EXPECT_NO_THROW(static_cast<void>(service_->admit(second)));
}

}  // namespace drives_test
}  // namespace stillmap::server
