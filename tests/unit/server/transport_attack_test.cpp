#include "transport_fixture.hpp"

#include <gmock/gmock.h>

#include <cstdio>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {
namespace transport_attack_test {

using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

class TransportAttack : public TransportTest {
 protected:
  void SetUp() override { start(small_endpoint()); }
};

TEST_F(TransportAttack, ManyRangesAreOneRefusal) {
  std::string ranges = "0-";
  for (int i = 0; i < 200; ++i) ranges += ",0-";
  EXPECT_THAT(ask("GET", "/source", "Range: bytes=" + ranges + "\r\n"), StartsWith("HTTP/1.1 416"));
  for (const char* range : {"9-1", "--1", "-", "a-b", "0-0, 2-2", "99999999999999999999999-"}) {
    EXPECT_THAT(ask("GET", "/source", "Range: bytes=" + std::string(range) + "\r\n"),
                StartsWith("HTTP/1.1 416"))
        << range;
  }
}

TEST_F(TransportAttack, PathsLeadNowhereInAnyEncoding) {
  for (const char* path :
       {"/../etc/passwd", "/x/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd",
        "/..%2f..%2fetc/passwd", "/x/..%2f..%2fetc%2fpasswd", "/%252e%252e/etc/passwd",
        "/..%5c..%5cetc", "/..%c0%af..", "/x/%u002e%u002e/a", "//etc/passwd", "/x/a%00.html/..",
        "/assets/../../etc/passwd"}) {
    const std::string answer = ask("GET", path);
    EXPECT_THAT(answer, AnyOf(StartsWith("HTTP/1.1 404"), StartsWith("HTTP/1.1 400")))
        << path << "\n"
        << answer;
    EXPECT_THAT(answer, Not(HasSubstr("root:")));
  }
}

// A proxy compares paths with its rules before or after it decodes them.
TEST_F(TransportAttack, EncodedSlashesAreNoSeparators) {
  EXPECT_THAT(ask("GET", "/x/a"), StartsWith("HTTP/1.1 200"));
  for (const char* path : {"/x%2fa", "/x%2Fa", "/x/a%2fb", "/x%5ca", "/x/a%5C"}) {
    EXPECT_THAT(ask("GET", path), StartsWith("HTTP/1.1 400")) << path;
  }
  EXPECT_THAT(ask("GET", "/x/a?b=c%2fd"), StartsWith("HTTP/1.1 200"));
}

// What a proxy and the server could read differently ends the connection, so that nothing that
// follows is taken for a request.
TEST_F(TransportAttack, SmugglingFormsAreRefused) {
  const std::string next = "GET /x/smuggled HTTP/1.1\r\nHost: localhost\r\n\r\n";
  const std::vector<std::string> heads = {
      "Content-Length: 4\r\nTransfer-Encoding: chunked\r\n",
      "Transfer-Encoding: chunked\r\nContent-Length: 4\r\n",
      "Content-Length: 4\r\nContent-Length: 5\r\n",
      "Content-Length: 4\r\nContent-Length: 4\r\n",
      "Content-Length: 4, 4\r\n",
      "Content-Length: +4\r\n",
      "Content-Length: -4\r\n",
      "Content-Length: 0x4\r\n",
      "Content-Length:\r\n",
      "Content-Length : 4\r\n",
      "X: a\r\n Content-Length: 4\r\n",
      "X: a\nContent-Length: 4\r\n",
      "X: a\rContent-Length: 4\r\n",
      ": 4\r\n",
      "no colon\r\n",
      "Host: y\r\n",
      "Authorization: Bearer a\r\nAuthorization: Bearer b\r\n",
      "If-Match: \"1\"\r\nIf-Match: \"2\"\r\n",
      "Content-Type: a/b\r\nContent-Type: c/d\r\n",
      "X\x01: a\r\n",
  };
  for (const std::string& head : heads) {
    const std::string answer =
        raw("POST /echo HTTP/1.1\r\nHost: localhost\r\n" + head + "\r\n0\r\n\r\n" + next);
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 400")) << head << answer;
    EXPECT_THAT(answer, Not(HasSubstr("smuggled"))) << head;
  }
  const std::string chunked =
      raw("POST /echo HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n" +
          next);
  EXPECT_THAT(chunked, StartsWith("HTTP/1.1 411"));
  EXPECT_THAT(chunked, Not(HasSubstr("smuggled")));
  const std::string get =
      raw("GET /livez HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n" +
          next);
  EXPECT_THAT(get, Not(HasSubstr("smuggled")));
}

TEST_F(TransportAttack, RequestLinesAreTakenByTheLetter) {
  for (const char* line :
       {"GET /livez", "GET  /livez HTTP/1.1", "GET /livez HTTP/2.0", "GET /livez HTTP/1.1 ",
        "GET /li vez HTTP/1.1", "G(T /livez HTTP/1.1", "GET livez HTTP/1.1", " GET /livez HTTP/1.1",
        "\x16\x03\x01", "GET /a\tb HTTP/1.1"}) {
    EXPECT_THAT(raw(std::string(line) + "\r\nHost: localhost\r\n\r\n"), StartsWith("HTTP/1.1 400"))
        << line;
  }
  EXPECT_THAT(raw("GET /livez HTTP/1.1\r\n\r\n"), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(raw("GET /livez HTTP/1.1\nHost: x\n\n"), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(ask("GET", "http://localhost/livez"), HasSubstr("alive"));
  for (const char* target : {"http://x/livez", "http://localhost:1/livez", "http:///livez",
                             "http://x@localhost/livez", "https://x"}) {
    EXPECT_THAT(ask("GET", target), StartsWith("HTTP/1.1 400")) << target;
  }
  EXPECT_THAT(raw("\r\nGET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"),
              HasSubstr("alive"));
}

TEST_F(TransportAttack, NulBytesEndNothing) {
  using namespace std::string_literals;
  EXPECT_THAT(raw("GET /livez\0/../x HTTP/1.1\r\nHost: localhost\r\n\r\n"s),
              StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(raw("GET /livez HTTP/1.1\r\nHost: localhost\r\nX: a\0b\r\n\r\n"s),
              StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(ask("GET", "/livez%00"), StartsWith("HTTP/1.1 404"));
  const std::string zeros(1000, '\0');
  EXPECT_THAT(raw(zeros + "\r\n\r\n"), StartsWith("HTTP/1.1 400"));
}

TEST_F(TransportAttack, PercentSignsInHeadersStayAsTheyAre) {
  const std::string answer =
      ask("GET", "/livez", "X-Request-Id: a%0d%0aSet-Cookie:b\r\nX: %00\r\n");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(answer, Not(HasSubstr("Set-Cookie")));
}

TEST_F(TransportAttack, HeadsAreBounded) {
  EXPECT_THAT(raw("GET /" + std::string(1 << 20, 'x')), StartsWith("HTTP/1.1 431"));
  std::string flood;
  for (int i = 0; i < 10'000; ++i) flood += "X: y\r\n";
  EXPECT_THAT(ask("GET", "/livez", flood), StartsWith("HTTP/1.1 431"));
  EXPECT_THAT(ask("GET", "/livez", "X: " + std::string(5000, 'y') + "\r\n"),
              StartsWith("HTTP/1.1 431"));
  EXPECT_TRUE(alive());
}

TEST_F(TransportAttack, LengthsBeyondEverythingAreRefusedAtOnce) {
  for (const char* length : {"4097", "18446744073709551615", "99999999999999999999999999"}) {
    EXPECT_THAT(raw("POST /echo HTTP/1.1\r\nHost: localhost\r\nContent-Length: " +
                    std::string(length) + "\r\n\r\n"),
                StartsWith("HTTP/1.1 413"))
        << length;
  }
  EXPECT_EQ(handler_.handled, 0);
}

TEST_F(TransportAttack, PackedBodiesAreBoundedAndChecked) {
  const std::string head =
      "POST /echo HTTP/1.1\r\nHost: localhost\r\nContent-Encoding: gzip\r\n"
      "Connection: close\r\nContent-Length: ";
  // "hello" by gzip -n.
  const std::string hello(
      "\x1f\x8b\x08\0\0\0\0\0\0\x03\xcb\x48\xcd\xc9\xc9\x07\0\x86\xa6\x10\x36\x05\0\0\0", 25);
  const auto post = [&](const std::string& body) {
    return raw(head + std::to_string(body.size()) + "\r\n\r\n" + body);
  };
  EXPECT_EQ(body_of(post(hello)), "hello");
  EXPECT_THAT(post(hello.substr(0, 20)), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(post(hello + "more"), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(post("plain text"), StartsWith("HTTP/1.1 400"));
}

TEST_F(TransportAttack, RouteBoundsItsBodyBelowTheServersBound) {
  const auto post = [&](const std::string& headers, const std::string& body) {
    return raw("POST /small HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + headers +
               "Content-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body);
  };
  EXPECT_EQ(body_of(post("", std::string(24, 'a'))), std::string(24, 'a'));
  EXPECT_THAT(post("", std::string(25, 'a')), StartsWith("HTTP/1.1 413"));
  // 30 times "a" by gzip -n, which the server's own bound allows.
  const std::string packed("\x1f\x8b\x08\0\0\0\0\0\0\x03KL\xc4\x07\0\xc1\xd3\xc1k\x1e\0\0\0", 23);
  EXPECT_THAT(post("Content-Encoding: gzip\r\n", packed), StartsWith("HTTP/1.1 413"));
}

/// Sends one byte each tenth of a second, for ever.
bool is_cut_off(RawClient& client, std::chrono::seconds within) {
  const auto begin = std::chrono::steady_clock::now();
  while (std::chrono::steady_clock::now() - begin < within) {
    if (!client.send("x")) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return false;
}

TEST_F(TransportAttack, DripsAreCutOff) {
  stop();
  Endpoint endpoint = small_endpoint();
  endpoint.limits.head = std::chrono::milliseconds(300);
  endpoint.limits.transfer = std::chrono::milliseconds(500);
  start(endpoint);
  RawClient head(port_);
  head.send("GET /livez HTTP/1.1\r\nX: ");
  RawClient body(port_);
  body.send("POST /echo HTTP/1.1\r\nHost: localhost\r\nContent-Length: 4000\r\n\r\n");
  EXPECT_TRUE(is_cut_off(head, std::chrono::seconds(4)));
  EXPECT_TRUE(is_cut_off(body, std::chrono::seconds(4)));
}

/// Bytes that the kernel keeps for the clients of a local port, from /proc/net/tcp.
std::uint64_t send_queues(int port) {
  std::ifstream table("/proc/net/tcp");
  std::string line;
  std::getline(table, line);
  std::uint64_t bytes = 0;
  while (std::getline(table, line)) {
    unsigned local_port = 0;
    unsigned long long queue = 0;
    if (std::sscanf(line.c_str(), " %*u: %*8x:%x %*s %*x %llx:", &local_port, &queue) == 2 &&
        static_cast<int>(local_port) == port)
      bytes += queue;
  }
  return bytes;
}

TEST_F(TransportAttack, ReaderThatNeverReadsTakesLittleMemory) {
  stop();
  Endpoint endpoint = small_endpoint();
  endpoint.limits.stall = std::chrono::seconds(60);
  endpoint.limits.transfer = std::chrono::seconds(60);
  endpoint.drain.timeout_s = 0;
  start(endpoint);
  RawClient client(port_);
  for (int i = 0; i < 100; ++i) client.send("GET /source HTTP/1.1\r\nHost: localhost\r\n\r\n");
  std::uint64_t queued = 0;
  std::uint64_t before = 1;
  for (int i = 0; i < 100 && (queued == 0 || queued != before); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    before = std::exchange(queued, send_queues(port_));
  }
  EXPECT_GT(queued, 0U);
  EXPECT_LE(queued, 192U << 10U);
}

// The kernel would keep what is not taken for it, long after the connection is closed.
TEST_F(TransportAttack, ReadersThatNeverReadAreGivenUpAndNothingIsKeptForThem) {
  RawClient pipelines(port_);
  for (int i = 0; i < 100; ++i) pipelines.send("GET /source HTTP/1.1\r\nHost: localhost\r\n\r\n");
  // Its answer fits into the buffers all but for some.
  RawClient asks_once(port_, 4096);
  asks_once.send("GET /source HTTP/1.1\r\nHost: localhost\r\nRange: bytes=0-40000\r\n\r\n");
  const auto is_over = [&] {
    const std::string text = metrics_.text();
    return text.find("stillmap_connections_total 2") != std::string::npos &&
           text.find("stillmap_connections 0") != std::string::npos;
  };
  for (int i = 0; i < 200 && !is_over(); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_TRUE(is_over());
  EXPECT_EQ(send_queues(port_), 0U);
}

TEST_F(TransportAttack, ReaderThatTakesItsTimeGetsAll) {
  RawClient client(port_, 4096);
  client.send(
      "GET /source HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n"
      "Range: bytes=0-99999\r\n\r\n");
  std::string all;
  char buffer[4096];
  for (;;) {
    // All of it takes longer than a reader that takes nothing is waited for.
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    const ssize_t got = ::recv(client.socket(), buffer, sizeof(buffer), 0);
    if (got <= 0) break;
    all.append(buffer, static_cast<std::size_t>(got));
  }
  EXPECT_EQ(all.size() - (all.find("\r\n\r\n") + 4), 100'000U);
}

}  // namespace transport_attack_test
}  // namespace stillmap::server
