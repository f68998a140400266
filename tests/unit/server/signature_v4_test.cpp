#include "blobs/signature_v4.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>
#include <stillmap/maps/map_package.hpp>

namespace stillmap::server {
namespace signature_v4_test {

using testing::EndsWith;

/// Of AWS's own test suite for Signature Version 4.
const S3Credentials kSuiteKey{"AKIDEXAMPLE", "wJalrXUtnFEMI/K7MDENG+bPxRfiCYEXAMPLEKEY"};
/// Of the examples in the documentation of S3.
const S3Credentials kS3Key{"AKIAIOSFODNN7EXAMPLE", "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY"};

RequestToSign suite_request(const std::string& method) {
  return {.method = method,
          .path = "/",
          .headers = {{"host", "example.amazonaws.com"}, {"x-amz-date", "20150830T123600Z"}},
          .body_sha256 = maps::sha256_of("")};
}

std::string suite_signature(const RequestToSign& request) {
  return authorization_v4(request, {.region = "us-east-1", .service = "service"}, kSuiteKey);
}

RequestToSign s3_request(const std::string& method, const std::string& path,
                         const std::string& body = "") {
  const std::string sha256 = maps::sha256_of(body);
  return {.method = method,
          .path = percent_encoded(path, /*is_path=*/true),
          .headers = {{"host", "examplebucket.s3.amazonaws.com"},
                      {"x-amz-date", "20130524T000000Z"},
                      {"x-amz-content-sha256", sha256}},
          .body_sha256 = sha256};
}

std::string s3_signature(const RequestToSign& request) {
  return authorization_v4(request, {.region = "us-east-1"}, kS3Key);
}

TEST(SignatureV4Test, SignsTheRequestsOfTheTestSuite) {
  EXPECT_EQ(suite_signature(suite_request("GET")),
            "AWS4-HMAC-SHA256 Credential=AKIDEXAMPLE/20150830/us-east-1/service/aws4_request, "
            "SignedHeaders=host;x-amz-date, "
            "Signature=5fa00fa31553b73ebf1942676e86291e8372ff2a2260956d9b8aae1d763fbf31");
  EXPECT_THAT(suite_signature(suite_request("POST")),
              EndsWith("=5da7c1a2acd57cee7505fc6676e4e544621c30862966e37dddb68e92efbe5d6b"));
  RequestToSign ordered = suite_request("GET");
  ordered.query = {{"Param2", "value2"}, {"Param1", "value1"}};
  EXPECT_THAT(suite_signature(ordered),
              EndsWith("=b97d918cfa904a5beff61c982a1b6f458b799221646efd99d3219ec94cdf2500"));
  RequestToSign of_utf8 = suite_request("GET");
  of_utf8.query = {{"\xE1\x88\xB4", "bar"}};
  EXPECT_THAT(suite_signature(of_utf8),
              EndsWith("=2cdec8eed098649ff3a119c94853b13c643bcf08f8b0a1d91e12c9027818dd04"));
}

TEST(SignatureV4Test, SignsTheExamplesOfS3) {
  RequestToSign get = s3_request("GET", "/test.txt");
  get.headers["range"] = "bytes=0-9";
  EXPECT_THAT(s3_signature(get),
              EndsWith("=f0e8bdb87c964420e857bd35b5d6ed310bd44f0170aba48dd91039c6036bdb41"));
  RequestToSign put = s3_request("PUT", "/test$file.text", "Welcome to Amazon S3.");
  put.headers["date"] = "Fri, 24 May 2013 00:00:00 GMT";
  put.headers["x-amz-storage-class"] = "REDUCED_REDUNDANCY";
  EXPECT_THAT(s3_signature(put),
              EndsWith("=98ad721746da40c64f1a55b78f14c238d841ea1380cd77a1b5971af0ece108bd"));
  RequestToSign lifecycle = s3_request("GET", "/");
  lifecycle.query = {{"lifecycle", ""}};
  EXPECT_THAT(s3_signature(lifecycle),
              EndsWith("=fea454ca298b7da1c68078a5d1bdbfbbe0d65c699e0f91ac7a200a0136783543"));
  RequestToSign list = s3_request("GET", "/");
  list.query = {{"prefix", "J"}, {"max-keys", "2"}};
  EXPECT_THAT(s3_signature(list),
              EndsWith("=34b48302e7b5fa45bde8084f4b7868a86f0a534bc59db6670ed5711ef69dc6f7"));
}

TEST(SignatureV4Test, EncodesAsAwsDoes) {
  EXPECT_EQ(percent_encoded("a b/c+d~e*"), "a%20b%2Fc%2Bd~e%2A");
  EXPECT_EQ(percent_encoded("/a b/c", true), "/a%20b/c");
  EXPECT_EQ(canonical_query({{"b", "x y"}, {"a", ""}, {"a%", "2"}}), "a=&a%25=2&b=x%20y");
}

TEST(SignatureV4Test, SignsNoRequestWithoutHostOrTime) {
  RequestToSign request = suite_request("GET");
  request.headers.erase("x-amz-date");
  EXPECT_THROW((void)suite_signature(request), std::invalid_argument);
  request = suite_request("GET");
  request.headers.erase("host");
  EXPECT_THROW((void)suite_signature(request), std::invalid_argument);
}

}  // namespace signature_v4_test
}  // namespace stillmap::server
