#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <stillmap/maps/map_package.hpp>
#include <string>
#include <vector>

#include "blobs/s3_client.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace s3_engine_test {

namespace fs = std::filesystem;
using std::chrono::hours;
using std::chrono::seconds;
using test::ThrowsSaying;

/// Against a real S3 engine that `tests/fleet/swift_test.py` starts: its address in
/// STILLMAP_TEST_S3, its bucket `maps`.
class S3EngineTest : public testing::Test {
 protected:
  void SetUp() override {
    const char* endpoint = std::getenv("STILLMAP_TEST_S3");
    if (endpoint == nullptr) GTEST_SKIP() << "STILLMAP_TEST_S3 names no S3 engine";
    options_.endpoint = endpoint;
    options_.bucket = "maps";
    options_.prefix = testing::UnitTest::GetInstance()->current_test_info()->name();
    options_.credentials_file = credentials("testing");
  }
  fs::path credentials(const std::string& secret) {
    const fs::path file = folder_.write("key_" + secret,
                                        "[default]\naws_access_key_id = test:tester\n"
                                        "aws_secret_access_key = " +
                                            secret + "\n");
    fs::permissions(file, fs::perms::owner_read | fs::perms::owner_write);
    return file;
  }
  static std::string random_bytes(std::size_t size, unsigned seed) {
    std::minstd_rand engine(seed + 1);
    std::string bytes(size, '\0');
    for (char& byte : bytes) byte = static_cast<char>(engine() >> 8U);
    return bytes;
  }
  static std::string get(S3Client& client, const std::string& key, const S3Range& range = {}) {
    std::string all;
    client.get(
        key, [&](std::string_view piece) { all += piece; }, range);
    return all;
  }

  test::TemporaryFolder folder_;
  S3Options options_;
};

TEST_F(S3EngineTest, WhatWasPutIsThere) {
  S3Client client(options_);
  const std::string bytes = random_bytes(3'000'000, 0);
  EXPECT_EQ(client.size_of("one"), std::nullopt);
  client.put("one", bytes, maps::sha256_of(bytes));
  client.put_file("two", folder_.write("file", bytes), maps::sha256_of(bytes));
  client.put("empty", "", maps::sha256_of(""));
  EXPECT_EQ(client.size_of("two"), bytes.size());
  EXPECT_EQ(get(client, "one"), bytes);
  EXPECT_EQ(get(client, "two", {.offset = 1'000, .bytes = 2'000}), bytes.substr(1'000, 2'000));
  EXPECT_EQ(get(client, "two", {.offset = 2'999'990}), bytes.substr(2'999'990));
  EXPECT_EQ(get(client, "empty"), "");
  std::vector<std::string> found;
  client.list("", [&](const S3Client::Listed& each) { found.push_back(each.key); });
  EXPECT_THAT(found, testing::ElementsAre("empty", "one", "two"));
  for (const std::string& key : found) client.remove(key);
  client.remove("one");
  client.list("", [&](const S3Client::Listed&) { FAIL(); });
  EXPECT_THROW((void)get(client, "one"), S3Error);
}

TEST_F(S3EngineTest, ListsMoreThanOnePage) {
  options_.page_objects = 3;
  S3Client client(options_);
  constexpr int kObjects = 8;
  for (int i = 0; i < kObjects; ++i) client.put(std::to_string(i), "", maps::sha256_of(""));
  int found = 0;
  client.list("", [&](const S3Client::Listed&) { ++found; });
  EXPECT_EQ(found, kObjects);
}

TEST_F(S3EngineTest, LargeFilesGoInParts) {
  options_.part_bytes = std::uint64_t{5} << 20U;
  S3Client client(options_);
  const std::string bytes = random_bytes(12'000'000, 1);
  client.put_file("large", folder_.write("file", bytes), maps::sha256_of(bytes));
  EXPECT_EQ(client.size_of("large"), bytes.size());
  EXPECT_EQ(get(client, "large"), bytes);
}

TEST_F(S3EngineTest, BytesOfAnotherDigestAreRefused) {
  S3Client client(options_);
  EXPECT_THAT([&] { client.put("one", "bytes", maps::sha256_of("others")); },
              ThrowsSaying<S3Error>({"400", "damaged or was changed"}));
  EXPECT_EQ(client.size_of("one"), std::nullopt);
}

TEST_F(S3EngineTest, AWrongSecretIsNamedWithoutIt) {
  options_.credentials_file = credentials("not_the_secret");
  S3Client client(options_);
  try {
    client.put("one", "", maps::sha256_of(""));
    FAIL();
  } catch (const S3Error& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("SignatureDoesNotMatch: check the access key"));
    EXPECT_THAT(error.what(), testing::Not(testing::HasSubstr("not_the_secret")));
  }
}

TEST_F(S3EngineTest, ABucketThatIsMissingIsNamed) {
  options_.bucket = "no-such-bucket";
  S3Client client(options_);
  EXPECT_THAT([&] { client.put("one", "", maps::sha256_of("")); },
              ThrowsSaying<S3Error>({"s3://no-such-bucket/", "NoSuchBucket: make the bucket"}));
}

TEST_F(S3EngineTest, AClockThatIsWrongIsNamed) {
  for (const auto& [offset, said] :
       {std::pair(-hours(2), "7200 s behind"), std::pair(+hours(2), "7200 s before")}) {
    S3Client client(options_,
                    [offset = offset] { return std::chrono::system_clock::now() + offset; });
    try {
      client.put("one", "", maps::sha256_of(""));
      FAIL();
    } catch (const S3Error& error) {
      // The server's time has whole seconds.
      EXPECT_THAT(error.what(),
                  testing::AnyOf(testing::HasSubstr(said), testing::HasSubstr("7199 s"),
                                 testing::HasSubstr("7201 s")));
      EXPECT_THAT(error.what(), testing::HasSubstr("NTP"));
    }
  }
}

/// Meanwhile the script kills the engine's servers, one after the other, and starts them again.
TEST_F(S3EngineTest, KillsHarmNothing) {
  const char* rounds = std::getenv("STILLMAP_TEST_S3_ROUNDS");
  if (rounds == nullptr) GTEST_SKIP() << "nobody kills the engine";
  S3Client client(options_);
  constexpr unsigned kKept = 8;
  std::vector<std::string> kept(kKept);
  for (unsigned i = 0; i < static_cast<unsigned>(std::atoi(rounds)); ++i) {
    const std::string key = std::to_string(i % kKept);
    std::string& bytes = kept[i % kKept];
    bytes = random_bytes(12'000'000, i);
    client.put(key, bytes, maps::sha256_of(bytes));
    // What was acknowledged before a kill is there after it.
    const unsigned other = (i * 5) % std::min(i + 1, kKept);
    EXPECT_EQ(get(client, std::to_string(other)), kept[other]) << i;
  }
}

}  // namespace s3_engine_test
}  // namespace stillmap::server
