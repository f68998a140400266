#include "http/http_server.hpp"
#include "errors/api_error.hpp"
#include "http/http_body.hpp"

#include <gmock/gmock.h>

#include <thread>

#include "raw_client.hpp"
#include "service_fixture.hpp"

// After what brings in Eigen, see http_server.cpp.
#include <httplib.h>

namespace stillmap::server {
namespace http_server_test {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

/// A server on a free port of this machine.
class HttpServerTest : public ServiceTest {
 protected:
  void SetUp() override {
    options_.port = 0;
    options_.keep_alive_s = 1;
    options_.stall_timeout_s = 1;
    options_.max_payload_bytes = 4096;
    options_.max_json_bytes = 4096;
    start();
    http_ = std::make_unique<HttpServer>(main_endpoint(options_), *service_, &service_->metrics());
    port_ = http_->bind();
    thread_ = std::thread([this] { http_->run(); });
  }
  void TearDown() override { stop(); }
  void stop() {
    http_->stop();
    if (thread_.joinable()) thread_.join();
  }

  std::string raw(std::string_view bytes) const {
    RawClient client(port_);
    client.send(bytes);
    return client.read_to_end();
  }
  httplib::Client client() const { return httplib::Client("127.0.0.1", port_); }
  static constexpr const char* kLocalize = "/v1/maps/town/localize?prior_t=1,2,3&prior_q=0,0,0,1";

  std::unique_ptr<HttpServer> http_;
  int port_ = 0;
  std::thread thread_;
};

TEST_F(HttpServerTest, AnswersAPoseRequest) {
  auto response = client().Post(kLocalize, raw_scan(60), "application/octet-stream");
  ASSERT_TRUE(response);
  EXPECT_EQ(response->status, 200) << response->body;
  EXPECT_EQ(response->get_header_value("Content-Type"), "application/json");
  EXPECT_EQ(response->get_header_value("X-Content-Type-Options"), "nosniff");
  EXPECT_EQ(nlohmann::json::parse(response->body)["status"], "ok");
}

TEST_F(HttpServerTest, MultipartTravelsWhole) {
  const httplib::MultipartFormDataItems parts = {
      {"request", R"({"prior": {"position": [1, 2, 3], "quaternion": [0, 0, 0, 1]}})", "",
       "application/json"},
      {"scan", raw_scan(60), "scan.bin", "application/octet-stream"}};
  auto response = client().Post("/v1/maps/town/localize", parts);
  ASSERT_TRUE(response);
  EXPECT_EQ(response->status, 200) << response->body;
  // An answer on a socket orders no memory.
  stop();
  EXPECT_EQ(aligner_->last_scan.size(), 60U);
}

TEST_F(HttpServerTest, KeepsOneConnectionForManyRequests) {
  RawClient client(port_);
  client.send(
      "GET /livez HTTP/1.1\r\nHost: localhost\r\n\r\nGET /nothing HTTP/1.1\r\nHost: "
      "localhost\r\n\r\n"
      "GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  const std::string answers = client.read_to_end();
  EXPECT_EQ(std::count(answers.begin(), answers.end(), '{'), 3) << answers;
  EXPECT_THAT(answers, HasSubstr("404"));
}

TEST_F(HttpServerTest, RequestIdIsTheClientsWhenItIsOne) {
  auto taken = client().Get("/livez", {{"X-Request-Id", "vehicle-7.42"}});
  EXPECT_EQ(taken->get_header_value("X-Request-Id"), "vehicle-7.42");
  auto refused = client().Get("/livez", {{"X-Request-Id", "no spaces"}});
  EXPECT_EQ(refused->get_header_value("X-Request-Id").size(), 16U);
}

TEST_F(HttpServerTest, HeadHasTheLengthAndNoBody) {
  const std::string answer =
      raw("HEAD /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(answer, HasSubstr("Content-Length: 31"));
  EXPECT_THAT(answer, Not(HasSubstr("alive")));
}

TEST_F(HttpServerTest, WrongMethodAndUnknownPathAreProblems) {
  auto wrong = client().Post("/livez", "x", "text/plain");
  ASSERT_TRUE(wrong);
  EXPECT_EQ(wrong->status, 405);
  EXPECT_EQ(wrong->get_header_value("Allow"), "GET, HEAD");
  EXPECT_EQ(wrong->get_header_value("Content-Type"), "application/problem+json");
  auto unknown = client().Get("/nothing");
  EXPECT_EQ(unknown->status, 404);
  EXPECT_EQ(nlohmann::json::parse(unknown->body)["code"], "UnknownRoute");
}

TEST_F(HttpServerTest, BodyBeyondTheLimitIsRefused) {
  auto response = client().Post(kLocalize, std::string(4097, 'x'), "application/octet-stream");
  ASSERT_TRUE(response);
  EXPECT_EQ(response->status, 413);
  EXPECT_EQ(nlohmann::json::parse(response->body)["code"], "PayloadTooLarge");
  EXPECT_THAT(raw("POST /v1/maps/town/localize HTTP/1.1\r\nHost: localhost\r\nContent-Length: "
                  "99999999999999999999999\r\n\r\n"),
              StartsWith("HTTP/1.1 413"));
}

TEST_F(HttpServerTest, UnpackedBytesCountAsWell) {
  // 1 MiB of zeros in about 1 kB of gzip.
  httplib::Client sender("127.0.0.1", port_);
  sender.set_compress(true);
  auto response = sender.Post(kLocalize, std::string(1 << 20, '\0'), "application/octet-stream");
  ASSERT_TRUE(response);
  EXPECT_EQ(response->status, 413) << response->body;
}

TEST(HttpBody, MayBeLeftOutWhereItIsOptional) {
  Route route;
  route.body = BodyKind::kWhole;
  const auto check = [&](const std::string& fields) {
    const RequestHead head =
        parse_head("POST /x HTTP/1.1\r\nHost: localhost\r\n" + fields + "\r\n");
    check_body(head, announced_length(head), route, {1000, 1000});
  };
  EXPECT_THROW(check(""), ApiError);
  route.body_is_optional = true;
  EXPECT_NO_THROW(check(""));
  EXPECT_NO_THROW(check("Content-Length: 7\r\n"));
  EXPECT_THROW(check("Content-Length: 1001\r\n"), ApiError);
  EXPECT_THROW(check("Transfer-Encoding: chunked\r\n"), ApiError);
}

TEST_F(HttpServerTest, BodyWithoutAKnownLengthIsRefused) {
  EXPECT_THAT(raw("POST /v1/maps/town/localize HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: "
                  "chunked\r\n\r\n5\r\nhello\r\n0\r\n\r\n"),
              HasSubstr("LengthRequired"));
  EXPECT_THAT(raw("POST /v1/maps/town/localize HTTP/1.1\r\nHost: localhost\r\n\r\n"),
              StartsWith("HTTP/1.1 411"));
  EXPECT_THAT(raw("POST /v1/maps/town/localize HTTP/1.1\r\nHost: localhost\r\nContent-Length: "
                  "many\r\n\r\n"),
              StartsWith("HTTP/1.1 400"));
}

TEST_F(HttpServerTest, UnknownContentEncodingIsRefused) {
  auto response = client().Post(kLocalize, httplib::Headers{{"Content-Encoding", "zstd"}},
                                raw_scan(60), "application/octet-stream");
  ASSERT_TRUE(response);
  EXPECT_EQ(response->status, 415);
}

TEST_F(HttpServerTest, ManyRangesAreRefusedAndOneIsIgnored) {
  auto many = client().Get("/livez", {{"Range", "bytes=0-1,3-4"}});
  EXPECT_EQ(many->status, 416);
  EXPECT_EQ(nlohmann::json::parse(many->body)["code"], "RangeNotSatisfiable");
  auto one = client().Get("/livez", {{"Range", "bytes=0-1"}});
  EXPECT_EQ(one->status, 200);
  EXPECT_EQ(one->body.size(), 31U);
}

TEST_F(HttpServerTest, GarbageIsAnsweredAndTheConnectionClosed) {
  EXPECT_THAT(raw("what is this\r\n\r\n"), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(raw("GET /livez HTTP/1.1\r\nHost: localhost\r\nRange: bytes=x\r\n\r\n"),
              StartsWith("HTTP/1.1 416"));
}

TEST_F(HttpServerTest, HeadOfARequestIsBounded) {
  // Each of these would otherwise be read into memory as long as it lasts, or take the thread's
  // stack.
  const std::string line(5000, 'x');
  EXPECT_THAT(raw("GET /" + line + " HTTP/1.1\r\nHost: localhost\r\n\r\n"),
              HasSubstr("HeaderTooLarge"));
  EXPECT_THAT(raw("GET /livez HTTP/1.1\r\nHost: localhost\r\nX: " + line + "\r\n\r\n"),
              StartsWith("HTTP/1.1 431"));
  std::string lines;
  for (int i = 0; i < 100; ++i) lines += "X: " + std::string(1000, 'x') + "\r\n";
  EXPECT_THAT(raw("GET /livez HTTP/1.1\r\nHost: localhost\r\n" + lines + "\r\n"),
              HasSubstr("HeaderTooLarge"));
  // A line of one character is no end of the head.
  EXPECT_THAT(raw("GET /livez HTTP/1.1\r\nHost: localhost\r\nx\n" + lines + "\r\n"),
              HasSubstr("HeaderTooLarge"));
  EXPECT_EQ(client().Get("/livez")->status, 200);
}

TEST_F(HttpServerTest, LongestLinesLeaveTheStackWhole) {
  std::string ranges = "bytes=0-0";
  while (ranges.size() < 4000) ranges += ",0-0";
  EXPECT_THAT(raw("GET /livez HTTP/1.1\r\nHost: localhost\r\nRange: " + ranges + "\r\n\r\n"),
              HasSubstr("416"));
  EXPECT_THAT(raw("POST /" + std::string(4000, 'a') +
                  " HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n"),
              HasSubstr("404"));
}

TEST_F(HttpServerTest, BodyThatStopsIsGivenUp) {
  const std::string answer = raw(
      "POST /v1/maps/town/localize?prior_t=1,2,3&prior_q=0,0,0,1 HTTP/1.1\r\nHost: localhost\r\n"
      "Content-Type: application/octet-stream\r\nContent-Length: 100\r\n\r\nshort");
  EXPECT_THAT(answer, HasSubstr("InvalidRequest"));
}

TEST_F(HttpServerTest, JsonIsPackedForClientsThatTakeIt) {
  auto packed = client().Get("/v1/maps/town", {{"Accept-Encoding", "br, gzip"}});
  EXPECT_EQ(packed->get_header_value("Content-Encoding"), "gzip");
  EXPECT_EQ(nlohmann::json::parse(packed->body)["name"], "town");
  auto plain = client().Get("/v1/maps/town", {{"Accept-Encoding", "br"}});
  EXPECT_FALSE(plain->has_header("Content-Encoding"));
}

TEST(HttpServerLife, StopsWithAnIdleConnectionAndBeforeItRuns) {
  const TownStore store;
  const ServerOptions options{.store = {}, .port = 0, .keep_alive_s = 60};
  const Service service(
      options, store.open(),
      [](const maps::MapPackage&, const localization::LocalizationOptions&) { return Aligners{}; },
      {});
  HttpServer early(options, service);
  early.bind();
  early.stop();
  early.run();

  HttpServer server(options, service);
  const int port = server.bind();
  std::thread thread([&] { server.run(); });
  RawClient idle(port);
  idle.send("GET /livez HTTP/1.1\r\nHost: localhost\r\n\r\n");
  const auto begin = std::chrono::steady_clock::now();
  server.stop();
  thread.join();
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(5));
}

TEST(HttpServerLife, AddressOfNobodyHereIsAnError) {
  const TownStore store;
  ServerOptions options{.store = {}, .port = 0};
  const Service service(
      options, store.open(),
      [](const maps::MapPackage&, const localization::LocalizationOptions&) { return Aligners{}; },
      {});
  HttpServer first(options, service);
  options.host = "192.0.2.1";  // of nobody, RFC 5737
  options.allow_remote = true;
  HttpServer second(options, service);
  EXPECT_GT(first.bind(), 0);
  EXPECT_THROW(second.bind(), std::runtime_error);
}

}  // namespace http_server_test
}  // namespace stillmap::server
