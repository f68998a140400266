#include "transport_fixture.hpp"

#include "http/http_range.hpp"
#include "http/listening_socket.hpp"

#include <gmock/gmock.h>

#include <chrono>
#include <memory>
#include <string>
#include <thread>

namespace stillmap::server {
namespace transport_test {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

class TransportSmall : public TransportTest {
 protected:
  void SetUp() override { start(small_endpoint()); }
};

std::string pattern(std::uint64_t first, std::uint64_t size) {
  std::string text;
  for (std::uint64_t i = 0; i < size; ++i) text.push_back(PatternSource::at(first + i));
  return text;
}

TEST_F(TransportSmall, SourceTravelsWholeAndByOneRange) {
  const std::string whole = ask("GET", "/source");
  EXPECT_THAT(whole, HasSubstr("Content-Length: 300000\r\n"));
  EXPECT_THAT(whole, HasSubstr("Accept-Ranges: bytes\r\n"));
  EXPECT_EQ(body_of(whole), pattern(0, 300'000));
  const std::string part = ask("GET", "/source", "Range: bytes=70000-200000\r\n");
  EXPECT_THAT(part, StartsWith("HTTP/1.1 206"));
  EXPECT_THAT(part, HasSubstr("Content-Range: bytes 70000-200000/300000\r\n"));
  EXPECT_EQ(body_of(part), pattern(70'000, 130'001));
  EXPECT_EQ(body_of(ask("GET", "/source", "Range: bytes=-10\r\n")), pattern(299'990, 10));
  EXPECT_EQ(body_of(ask("GET", "/source", "Range: bytes=299999-\r\n")), pattern(299'999, 1));
  const std::string beyond = ask("GET", "/source", "Range: bytes=300000-\r\n");
  EXPECT_THAT(beyond, StartsWith("HTTP/1.1 416"));
  EXPECT_THAT(beyond, HasSubstr("Content-Range: bytes */300000\r\n"));
}

TEST_F(TransportSmall, SourceWithoutAByteEnds) {
  const std::string answer = ask("GET", "/empty");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(answer, HasSubstr("Content-Length: 0\r\n"));
  EXPECT_THAT(answer, HasSubstr("Content-Type: text/css\r\n"));
}

// A server that stops, or makes room, ends the reading of idle connections: that is not the client.
TEST(BoundedSocket, PeerHasLeftOnceItClosesByItself) {
  const ListeningSocket listening("127.0.0.1", 0);
  auto client = std::make_unique<RawClient>(listening.port());
  int handle = -1;
  for (int i = 0; i < 1000 && handle < 0; ++i) {
    handle = listening.accept(std::chrono::seconds(1));
    if (handle < 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  ASSERT_GE(handle, 0);
  const BoundedSocket socket(handle, {});
  EXPECT_FALSE(socket.peer_left());
  ::shutdown(handle, SHUT_RD);
  EXPECT_FALSE(socket.peer_left());
  client.reset();
  for (int i = 0; i < 1000 && !socket.peer_left(); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_TRUE(socket.peer_left());
  ::close(handle);
}

TEST_F(TransportSmall, HeadOfASourceHasItsLengthAndNoBody) {
  const std::string answer = ask("HEAD", "/source", "Range: bytes=0-9\r\n");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(answer, HasSubstr("Content-Length: 300000\r\n"));
  EXPECT_EQ(body_of(answer), "");
}

TEST_F(TransportSmall, ConditionsAreComparedWithTheTag) {
  for (const char* tags : {"\"v1\"", "W/\"v1\"", "\"v0\", \"v1\"", "*"})
    EXPECT_TRUE(lists_tag(tags, "\"v1\"")) << tags;
  EXPECT_FALSE(lists_tag("\"v10\"", "\"v1\""));
  // Whether a client has it already, handlers know: a tag may be a revision's, for If-Match.
  EXPECT_THAT(ask("GET", "/source", "If-None-Match: \"v1\"\r\n"), StartsWith("HTTP/1.1 200"));
  const std::string range = "Range: bytes=0-9\r\nIf-Range: ";
  EXPECT_THAT(ask("GET", "/source", range + "\"v1\"\r\n"), StartsWith("HTTP/1.1 206"));
  EXPECT_THAT(ask("GET", "/source", range + "\"v0\"\r\n"), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(ask("GET", "/source", range + "W/\"v1\"\r\n"), StartsWith("HTTP/1.1 200"));
}

TEST_F(TransportSmall, SourceThatBreaksEndsTheConnectionEarly) {
  const std::string answer = ask("GET", "/broken");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_LT(body_of(answer).size(), 100'001U);
  EXPECT_TRUE(alive());
}

TEST_F(TransportSmall, ClientThatLeavesDuringASourceHarmsNobody) {
  for (int i = 0; i < 5; ++i) {
    RawClient client(port_);
    client.send("GET /source HTTP/1.1\r\nHost: localhost\r\n\r\n");
    client.read_until("\r\n\r\n");
  }
  EXPECT_TRUE(alive());
}

TEST_F(TransportSmall, BodyIsInvitedOnlyOnceItIsAdmitted) {
  RawClient client(port_);
  client.send(
      "POST /echo HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\nExpect: 100-continue\r\n"
      "Connection: close\r\n\r\n");
  EXPECT_EQ(client.read_until("\r\n\r\n"), "HTTP/1.1 100 Continue\r\n\r\n");
  client.send("hello");
  const std::string answer = client.read_to_end();
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_EQ(body_of(answer), "hello");

  const std::string expect = "Content-Length: 5\r\nExpect: 100-continue\r\n";
  EXPECT_THAT(ask("POST", "/nothing", expect), StartsWith("HTTP/1.1 404"));
  EXPECT_THAT(ask("POST", "/livez", expect), StartsWith("HTTP/1.1 405"));
  EXPECT_THAT(ask("POST", "/echo", expect + "Authorization: Bearer wrong\r\n"),
              StartsWith("HTTP/1.1 503"));
  EXPECT_THAT(ask("POST", "/echo", "Content-Length: 5000\r\nExpect: 100-continue\r\n"),
              StartsWith("HTTP/1.1 413"));
}

TEST_F(TransportSmall, RefusalIsReadByAClientThatGoesOnSending) {
  RawClient client(port_);
  client.send(
      "POST /echo HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer wrong\r\nContent-Length: "
      "4000\r\n\r\nhalf");
  client.send(std::string(2000, 'x'));
  const std::string answer = client.read_to_end();
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 503"));
  EXPECT_THAT(answer, HasSubstr("Retry-After: 1\r\n"));
  EXPECT_THAT(answer, HasSubstr("Connection: close\r\n"));
}

TEST_F(TransportSmall, StreamedBodyIsReadByItsHandler) {
  const std::string head = "PUT /stream HTTP/1.1\r\nHost: localhost\r\nContent-Length: ";
  RawClient client(port_);
  client.send(head + "100000\r\n\r\n" + std::string(100'000, 'x'));
  EXPECT_THAT(client.read_until("took 100000"), HasSubstr("Keep-Alive"));
  client.send(head + "3\r\nConnection: close\r\n\r\nabc");
  EXPECT_THAT(client.read_to_end(), HasSubstr("took 3"));
  EXPECT_THAT(raw(head + "1000001\r\n\r\n"), StartsWith("HTTP/1.1 413"));
  EXPECT_THAT(raw(head + "3\r\nContent-Encoding: gzip\r\n\r\nabc"), StartsWith("HTTP/1.1 415"));
  EXPECT_THAT(raw(head + "30\r\n\r\nabc"), HasSubstr("InvalidRequest"));
}

TEST_F(TransportSmall, UnreadBodyEndsTheConnection) {
  RawClient client(port_);
  client.send(
      "PUT /unread HTTP/1.1\r\nHost: localhost\r\nContent-Length: 50\r\n\r\nGET /livez HTTP/1.1");
  const std::string answer = client.read_to_end();
  EXPECT_THAT(answer, HasSubstr("not looked at"));
  EXPECT_THAT(answer, HasSubstr("Connection: close\r\n"));
  EXPECT_EQ(handler_.handled, 1);
}

TEST_F(TransportSmall, DeleteWorksWithAndWithoutABody) {
  EXPECT_THAT(ask("DELETE", "/x/a"), StartsWith("HTTP/1.1 204"));
  EXPECT_THAT(raw("DELETE /x/a HTTP/1.1\r\nHost: localhost\r\nContent-Length: 2\r\n\r\n{}"),
              StartsWith("HTTP/1.1 204"));
}

TEST_F(TransportSmall, OtherMethodsAreRefused) {
  for (const char* method : {"OPTIONS", "TRACE", "PATCH", "PROPFIND"}) {
    EXPECT_THAT(ask(method, "/livez"), StartsWith("HTTP/1.1 405")) << method;
    EXPECT_THAT(ask(method, "/nothing"), StartsWith("HTTP/1.1 404")) << method;
  }
  EXPECT_THAT(ask("CONNECT", "example.org:443"), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(ask("OPTIONS", "*"), StartsWith("HTTP/1.1 404"));
}

TEST_F(TransportSmall, EveryAnswerHasItsHeaders) {
  for (const char* target : {"/livez", "/nothing", "/source", "/a?b?c"}) {
    const std::string answer = ask("GET", target);
    EXPECT_THAT(answer, HasSubstr("X-Content-Type-Options: nosniff\r\n")) << target;
    EXPECT_THAT(answer, HasSubstr("Cross-Origin-Resource-Policy: same-origin\r\n"));
    EXPECT_THAT(answer, HasSubstr("Referrer-Policy: no-referrer\r\n"));
    EXPECT_THAT(answer, HasSubstr("Content-Security-Policy: default-src 'none'"));
    EXPECT_THAT(answer, ::testing::ContainsRegex("Date: [A-Z][a-z]+, [0-9]+ [A-Z][a-z]+ 20"));
    EXPECT_THAT(answer, Not(HasSubstr("Server:")));
    EXPECT_THAT(answer, Not(HasSubstr("Access-Control")));
    EXPECT_THAT(answer, Not(HasSubstr("Strict-Transport-Security")));
  }
  EXPECT_THAT(ask("GET", "/livez"), HasSubstr("Cache-Control: no-store\r\n"));
  EXPECT_THAT(ask("GET", "/source"), HasSubstr("Cache-Control: private, immutable\r\n"));
}

TEST_F(TransportSmall, OldClientsGetWhatTheyUnderstand) {
  const std::string answer = raw("GET /livez HTTP/1.0\r\n\r\n");
  EXPECT_THAT(answer, HasSubstr("Connection: close\r\n"));
  EXPECT_THAT(raw("POST /echo HTTP/1.0\r\nExpect: 100-continue\r\nContent-Length: 2\r\n\r\nhi"),
              StartsWith("HTTP/1.1 200"));
  RawClient client(port_);
  client.send("GET /events HTTP/1.0\r\n\r\n");
  EXPECT_THAT(client.read_until("data: {}\n\n"), Not(HasSubstr("chunked")));
}

TEST_F(TransportSmall, EventStreamsAreCountedAndCapped) {
  const std::string request = "GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n";
  RawClient first(port_);
  {
    RawClient second(port_);
    for (RawClient* client : {&first, &second}) {
      client->send(request);
      EXPECT_THAT(client->read_until("data: {}\n\n"), HasSubstr("text/event-stream"));
    }
    const std::string third = ask("GET", "/events");
    EXPECT_THAT(third, StartsWith("HTTP/1.1 503"));
    EXPECT_THAT(third, HasSubstr("TooManyStreams"));
    EXPECT_THAT(third, HasSubstr("Retry-After"));
    EXPECT_THAT(metrics_.text(), HasSubstr("stillmap_event_streams 2"));
  }
  // The place of a client that went is free again, without waiting for a comment to fail.
  for (int i = 0; i < 100 && metrics_.text().find("event_streams 1") == std::string::npos; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_THAT(metrics_.text(), HasSubstr("stillmap_event_streams 1"));
}

TEST_F(TransportSmall, RequestsAreCounted) {
  ask("GET", "/x/a");
  ask("GET", "/x/b");
  ask("GET", "/nothing");
  raw("POST /echo HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\nConnection: "
      "close\r\n\r\nhello");
  const std::string text = metrics_.text();
  EXPECT_THAT(text,
              HasSubstr("requests_total{method=\"GET\",route=\"/x/{name}\",status=\"2xx\"} 2"));
  EXPECT_THAT(text, HasSubstr("requests_total{method=\"GET\",route=\"none\",status=\"4xx\"} 1"));
  EXPECT_THAT(text, HasSubstr("stillmap_http_received_body_bytes_total 5"));
  EXPECT_THAT(text, HasSubstr("stillmap_http_problems_total{code=\"UnknownRoute\"} 1"));
  EXPECT_THAT(text, HasSubstr("stillmap_http_requests_in_flight 0"));
  EXPECT_THAT(text, HasSubstr("stillmap_connections_total 4"));
}

}  // namespace transport_test
}  // namespace stillmap::server
