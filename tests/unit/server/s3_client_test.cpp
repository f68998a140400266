#include "blobs/s3_client.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <stillmap/maps/map_package.hpp>
#include <string>
#include <thread>
#include <vector>

#include "support/scripted_http_server.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace s3_client_test {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using test::ScriptedHttpServer;
using test::ThrowsSaying;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

const std::string kSecret = "wJalrXUtnFEMI-a-secret";

TEST(RetryPolicyTest, PausesDoubleUpToABoundAndAreRandom) {
  const RetryPolicy policy{.attempts = 6,
                           .first_pause = milliseconds(100),
                           .longest_pause = milliseconds(500),
                           .within = milliseconds(10'000)};
  const milliseconds soon{0};
  EXPECT_EQ(policy.pause(1, soon, 0.0), milliseconds(50));
  EXPECT_EQ(policy.pause(1, soon, 0.999), milliseconds(100));
  EXPECT_EQ(policy.pause(3, soon, 0.0), milliseconds(200));
  EXPECT_EQ(policy.pause(5, soon, 0.0), milliseconds(250));
  EXPECT_EQ(policy.pause(6, soon, 0.0), std::nullopt);
  EXPECT_EQ(policy.pause(1, milliseconds(9'960), 0.0), std::nullopt);
  EXPECT_EQ(policy.pause(1, soon, 0.0, milliseconds(700)), milliseconds(700));
  EXPECT_EQ(policy.pause(1, soon, 0.0, milliseconds(20'000)), std::nullopt);
}

class S3ClientTest : public testing::Test {
 protected:
  S3ClientTest() {
    const fs::path file = folder_.write(
        "credentials", "aws_access_key_id = test:tester\naws_secret_access_key = " + kSecret);
    fs::permissions(file, fs::perms::owner_read);
    options_.endpoint = server_.url();
    options_.bucket = "maps";
    options_.prefix = "fleet";
    options_.credentials_file = file;
    options_.retry = {.attempts = 3,
                      .first_pause = milliseconds(1),
                      .longest_pause = milliseconds(2),
                      .within = milliseconds(5'000)};
    options_.transport.stall_timeout = std::chrono::seconds(2);
  }
  S3Client client() { return S3Client(options_); }
  static std::string get(S3Client& client, const S3Range& range = {}) {
    std::string all;
    client.get(
        "blob", [&](std::string_view piece) { all += piece; }, range);
    return all;
  }
  static ScriptedHttpServer::Answer error(int status, const std::string& code) {
    return {.status = status,
            .headers = {"Content-Type: application/xml"},
            .body = "<?xml version='1.0'?><Error><Code>" + code + "</Code><Message>" + kSecret +
                    "</Message></Error>"};
  }

  test::TemporaryFolder folder_;
  ScriptedHttpServer server_;
  S3Options options_;
};

TEST_F(S3ClientTest, PutsWithTheDigestOfTheBody) {
  server_.add({});
  S3Client(options_).put("ab cd", "body", maps::sha256_of("body"));
  ASSERT_EQ(server_.asked().size(), 1U);
  const auto asked = server_.asked().front();
  EXPECT_EQ(asked.method, "PUT");
  EXPECT_EQ(asked.target, "/maps/fleet/ab%20cd");
  EXPECT_EQ(asked.body, "body");
  EXPECT_EQ(asked.headers.at("x-amz-content-sha256"), maps::sha256_of("body"));
  EXPECT_THAT(asked.headers.at("authorization"),
              HasSubstr("SignedHeaders=host;x-amz-content-sha256;x-amz-date,"));
  EXPECT_FALSE(asked.headers.contains("x-amz-security-token"));
}

TEST_F(S3ClientTest, AVirtualHostedBucketIsPartOfTheHost) {
  options_.virtual_hosted = true;
  options_.endpoint = "http://localhost:" + server_.url().substr(server_.url().rfind(':') + 1);
  server_.add({.body = "text"});
  S3Client client(options_);
  // *.localhost is this machine (RFC 6761), without any DNS.
  EXPECT_EQ(get(client), "text");
  EXPECT_EQ(server_.asked().front().target, "/fleet/blob");
  EXPECT_THAT(server_.asked().front().headers.at("host"), testing::StartsWith("maps.localhost:"));
}

TEST_F(S3ClientTest, ATemporaryKeySendsItsToken) {
  const fs::path file = folder_.write(
      "temporary", "aws_access_key_id=a\naws_secret_access_key=b\naws_session_token=token\n");
  fs::permissions(file, fs::perms::owner_read);
  options_.credentials_file = file;
  server_.add({});
  client().remove("blob");
  const auto asked = server_.asked().front();
  EXPECT_EQ(asked.headers.at("x-amz-security-token"), "token");
  EXPECT_THAT(asked.headers.at("authorization"), HasSubstr("x-amz-security-token,"));
}

TEST_F(S3ClientTest, ConnectionsAreUsedAgain) {
  for (int i = 0; i < 3; ++i) server_.add({.body = "text"});
  S3Client client(options_);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(get(client), "text");
  for (const auto& asked : server_.asked()) EXPECT_EQ(asked.connection, 0);
}

TEST_F(S3ClientTest, MoreThreadsThanConnectionsWait) {
  options_.transport.connections = 2;
  for (int i = 0; i < 12; ++i) server_.add({.body = "text"});
  S3Client client(options_);
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < 12; ++i) threads.emplace_back([&] { EXPECT_EQ(get(client), "text"); });
  }
  for (const auto& asked : server_.asked()) EXPECT_LT(asked.connection, 2);
}

TEST_F(S3ClientTest, TriesAgainWhatMayPass) {
  server_.add(error(503, "SlowDown"));
  server_.add({.drops = true});
  server_.add({});
  client().put("blob", "body", maps::sha256_of("body"));
  ASSERT_EQ(server_.asked().size(), 3U);
  for (const auto& asked : server_.asked()) EXPECT_EQ(asked.body, "body");
}

TEST_F(S3ClientTest, TriesAreBounded) {
  for (int i = 0; i < 9; ++i) server_.add(error(500, "InternalError"));
  EXPECT_THAT([&] { client().put("blob", "", maps::sha256_of("")); },
              ThrowsSaying<S3Error>({"s3://maps/fleet/blob", "500 InternalError"}));
  EXPECT_EQ(server_.asked().size(), 3U);
}

TEST_F(S3ClientTest, KnowsWhetherItIsAway) {
  S3Client client(options_);
  EXPECT_FALSE(client.figures().is_away);
  for (int i = 0; i < 3; ++i) server_.add(error(503, "SlowDown"));
  EXPECT_THROW((void)get(client), S3Error);
  EXPECT_TRUE(client.figures().is_away);
  server_.add(error(404, "NoSuchKey"));
  EXPECT_THROW((void)get(client), S3Error);
  EXPECT_FALSE(client.figures().is_away);
  EXPECT_EQ(client.figures().failed, 3U);
  EXPECT_EQ(client.figures().answered, 1U);
}

TEST_F(S3ClientTest, WhatCannotPassIsNotTriedAgain) {
  for (const auto& [status, code] : {std::pair(403, "AccessDenied"), std::pair(404, "NoSuchKey"),
                                     std::pair(501, "NotImplemented")})
    server_.add(error(status, code));
  S3Client client(options_);
  for (int i = 0; i < 3; ++i) EXPECT_THROW((void)get(client), S3Error);
  EXPECT_EQ(server_.asked().size(), 3U);
}

TEST_F(S3ClientTest, WithoutAServerItSaysSo) {
  options_.endpoint = "http://127.0.0.1:1";
  EXPECT_THAT([&] { client().remove("blob"); },
              ThrowsSaying<S3Error>({"s3://maps/fleet/blob", "http://127.0.0.1:1"}));
}

TEST_F(S3ClientTest, AGetGoesOnAfterALostConnection) {
  server_.add({.body = "0123456789", .cut_after = 4});
  server_.add(error(503, "SlowDown"));
  server_.add({.status = 206, .body = "456789"});
  S3Client client(options_);
  EXPECT_EQ(get(client), "0123456789");
  EXPECT_EQ(server_.asked().at(2).headers.at("range"), "bytes=4-");
}

TEST_F(S3ClientTest, AServerWithoutRangesSendsAllAgain) {
  server_.add({.body = "0123456789", .cut_after = 4});
  server_.add({.body = "0123456789"});
  S3Client client(options_);
  EXPECT_EQ(get(client), "0123456789");
}

TEST_F(S3ClientTest, ARangeIsWhatWasAskedFor) {
  server_.add({.status = 206, .body = "234", .cut_after = 1});
  server_.add({.status = 206, .body = "34"});
  server_.add({.body = "0123456789"});
  S3Client client(options_);
  EXPECT_EQ(get(client, {.offset = 2, .bytes = 3}), "234");
  EXPECT_EQ(server_.asked().at(0).headers.at("range"), "bytes=2-4");
  EXPECT_EQ(server_.asked().at(1).headers.at("range"), "bytes=3-4");
  EXPECT_EQ(get(client, {.offset = 2, .bytes = 3}), "234");
}

TEST_F(S3ClientTest, WhatTheSinkThrowsComesOut) {
  server_.add({.body = "text"});
  EXPECT_THAT(
      [&] { client().get("blob", [](std::string_view) { throw std::logic_error("enough"); }); },
      ThrowsSaying<std::logic_error>({"enough"}));
  EXPECT_EQ(server_.asked().size(), 1U);
}

TEST_F(S3ClientTest, ListsPageByPage) {
  server_.add({.body = "<ListBucketResult><IsTruncated>true</IsTruncated>"
                       "<NextContinuationToken>a b&amp;</NextContinuationToken>"
                       "<Contents><Key>fleet/blobs/1</Key><LastModified>T</LastModified>"
                       "<Size>5</Size></Contents></ListBucketResult>"});
  server_.add({.body = "<ListBucketResult><IsTruncated>false</IsTruncated>"
                       "<Contents><Key>fleet/blobs/2</Key><Size>6</Size></Contents>"
                       "</ListBucketResult>"});
  std::vector<std::string> found;
  client().list("blobs/", [&](const S3Client::Listed& each) {
    found.push_back(each.key + " " + std::to_string(each.bytes));
  });
  EXPECT_THAT(found, ElementsAre("blobs/1 5", "blobs/2 6"));
  EXPECT_EQ(server_.asked().at(0).target,
            "/maps?list-type=2&max-keys=1000&prefix=fleet%2Fblobs%2F");
  EXPECT_EQ(server_.asked().at(1).target,
            "/maps?continuation-token=a%20b%26&list-type=2&max-keys=1000&prefix=fleet%2Fblobs%2F");
}

TEST_F(S3ClientTest, HeadTellsBytesOrNothing) {
  server_.add({.headers = {"Content-Length: 1234"}, .has_body = false});
  server_.add({.status = 404, .headers = {"Content-Length: 0"}, .has_body = false});
  S3Client client(options_);
  EXPECT_EQ(client.size_of("blob"), 1234U);
  EXPECT_EQ(client.size_of("blob"), std::nullopt);
}

TEST_F(S3ClientTest, AClockThatIsWrongIsNamed) {
  ScriptedHttpServer::Answer answer = error(403, "RequestTimeTooSkewed");
  answer.headers.emplace_back("Date: Sun, 06 Nov 1994 08:49:37 GMT");
  server_.add(answer);
  S3Client client(options_,
                  [] { return std::chrono::system_clock::from_time_t(784111777 - 3600); });
  EXPECT_THAT([&] { client.remove("blob"); },
              ThrowsSaying<S3Error>({"clock of this machine is 3600 s behind", "NTP"}));
}

TEST_F(S3ClientTest, NoMessageHoldsASecret) {
  for (const char* code : {"SignatureDoesNotMatch", "InvalidAccessKeyId", "AccessDenied"}) {
    server_.add(error(403, code));
    try {
      client().remove("blob");
      FAIL() << code;
    } catch (const S3Error& failure) {
      EXPECT_THAT(failure.what(), AllOf(HasSubstr(code), HasSubstr("check"),
                                        Not(HasSubstr(kSecret)), Not(HasSubstr("test:tester"))));
    }
  }
}

TEST_F(S3ClientTest, LargeFilesGoInParts) {
  options_.part_bytes = std::uint64_t{5} << 20U;
  const std::string bytes(std::size_t{11} << 20U, 'x');
  const fs::path file = folder_.write("large", bytes);
  server_.add({.body = "<X><UploadId>up/1</UploadId></X>"});
  server_.add({.headers = {"ETag: \"one\""}});
  server_.add({.drops = true});
  server_.add({.headers = {"ETag: \"two\""}});
  server_.add({.headers = {"ETag: \"three\""}});
  server_.add({.body = "<CompleteMultipartUploadResult/>"});
  client().put_file("blob", file, maps::sha256_of(bytes));
  const auto asked = server_.asked();
  ASSERT_EQ(asked.size(), 6U);
  EXPECT_EQ(asked[0].target, "/maps/fleet/blob?uploads=");
  EXPECT_EQ(asked[3].target, "/maps/fleet/blob?partNumber=2&uploadId=up%2F1");
  EXPECT_EQ(asked[3].body.size(), std::size_t{5} << 20U);
  EXPECT_EQ(asked[4].body.size(), std::size_t{1} << 20U);
  EXPECT_EQ(asked[5].body,
            "<CompleteMultipartUpload>"
            "<Part><PartNumber>1</PartNumber><ETag>&quot;one&quot;</ETag></Part>"
            "<Part><PartNumber>2</PartNumber><ETag>&quot;two&quot;</ETag></Part>"
            "<Part><PartNumber>3</PartNumber><ETag>&quot;three&quot;</ETag></Part>"
            "</CompleteMultipartUpload>");
}

TEST_F(S3ClientTest, ALargeFileOfOtherBytesIsNotStored) {
  options_.part_bytes = std::uint64_t{5} << 20U;
  const fs::path file = folder_.write("large", std::string(std::size_t{6} << 20U, 'x'));
  server_.add({.body = "<X><UploadId>1</UploadId></X>"});
  server_.add({.headers = {"ETag: \"one\""}});
  server_.add({.headers = {"ETag: \"two\""}});
  server_.add({.status = 204});
  EXPECT_THAT([&] { client().put_file("blob", file, maps::sha256_of("y")); },
              ThrowsSaying<maps::StorageError>({file.string(), maps::sha256_of("y"), "read the"}));
  ASSERT_EQ(server_.asked().size(), 4U);
  EXPECT_EQ(server_.asked()[3].method, "DELETE");
  EXPECT_EQ(server_.asked()[3].target, "/maps/fleet/blob?uploadId=1");
}

TEST_F(S3ClientTest, PartsOfAFailedUploadAreRemoved) {
  options_.part_bytes = std::uint64_t{5} << 20U;
  const fs::path file = folder_.write("large", std::string(std::size_t{6} << 20U, 'x'));
  server_.add({.body = "<X><UploadId>1</UploadId></X>"});
  server_.add(error(403, "AccessDenied"));
  server_.add({.status = 204});
  EXPECT_THROW(client().put_file("blob", file, maps::sha256_of("")), S3Error);
  EXPECT_EQ(server_.asked().at(2).method, "DELETE");
  EXPECT_EQ(server_.asked().at(2).target, "/maps/fleet/blob?uploadId=1");
}

TEST_F(S3ClientTest, AnErrorBehindA200IsAnError) {
  options_.part_bytes = std::uint64_t{5} << 20U;
  const std::string bytes(std::size_t{6} << 20U, 'x');
  const fs::path file = folder_.write("large", bytes);
  server_.add({.body = "<X><UploadId>1</UploadId></X>"});
  server_.add({.headers = {"ETag: \"one\""}});
  server_.add({.headers = {"ETag: \"two\""}});
  server_.add(error(200, "EntityTooSmall"));
  server_.add({.status = 204});
  EXPECT_THAT([&] { client().put_file("blob", file, maps::sha256_of(bytes)); },
              ThrowsSaying<S3Error>({"EntityTooSmall"}));
}

TEST_F(S3ClientTest, StopEndsPauses) {
  options_.retry = {.attempts = 100,
                    .first_pause = milliseconds(600'000),
                    .longest_pause = milliseconds(600'000),
                    .within = milliseconds(86'400'000)};
  server_.add(error(503, "SlowDown"));
  S3Client client(options_);
  const std::jthread other([&] {
    while (server_.asked().empty()) std::this_thread::sleep_for(milliseconds(1));
    client.stop();
  });
  EXPECT_THROW(client.remove("blob"), S3Error);
}

TEST_F(S3ClientTest, RefusesOptionsThatCannotWork) {
  for (const char* endpoint : {"", "ftp://host", "http://", "http://host/path", "http://a b"}) {
    options_.endpoint = endpoint;
    EXPECT_THROW((void)client(), std::invalid_argument) << endpoint;
  }
  options_.endpoint = "http://user:" + kSecret + "@host";
  try {
    S3Client made(options_);
    FAIL();
  } catch (const std::invalid_argument& refused) {
    EXPECT_THAT(refused.what(), AllOf(HasSubstr("credentials"), Not(HasSubstr(kSecret))));
  }
  options_.endpoint = server_.url();
  options_.bucket = "a/b";
  EXPECT_THROW((void)client(), std::invalid_argument);
}

}  // namespace s3_client_test
}  // namespace stillmap::server
