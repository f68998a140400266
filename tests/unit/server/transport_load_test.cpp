#include "transport_fixture.hpp"

#include <gmock/gmock.h>

#include <deque>
#include <string>

namespace stillmap::server {
namespace transport_load_test {

using ::testing::HasSubstr;
using ::testing::StartsWith;
using Clock = std::chrono::steady_clock;

constexpr const char* kEvents = "GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n";

class TransportLoad : public TransportTest {
 protected:
  /// Waits until so many connections are open.
  void wait_for_connections(int count) const {
    const std::string line = "\nstillmap_connections " + std::to_string(count) + "\n";
    for (int i = 0; i < 500 && metrics_.text().find(line) == std::string::npos; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    EXPECT_THAT(metrics_.text(), HasSubstr(line));
  }
  double stop_seconds() {
    const Clock::time_point begin = Clock::now();
    stop();
    return std::chrono::duration<double>(Clock::now() - begin).count();
  }
};

TEST_F(TransportLoad, IdleSlowAndListeningClientsLeaveRoomForQueries) {
  // The defaults, but for patience: the test must find all of them there at once.
  Endpoint endpoint = main_endpoint(ServerOptions{});
  endpoint.port = 0;
  endpoint.limits.keep_alive = std::chrono::seconds(60);
  endpoint.limits.head = std::chrono::seconds(60);
  endpoint.limits.stall = std::chrono::seconds(60);
  start(endpoint);
  std::deque<RawClient> clients;
  for (int i = 0; i < 200; ++i) clients.emplace_back(port_);
  for (int i = 0; i < 50; ++i) {
    clients.emplace_back(port_).send(
        "POST /echo HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\nh");
  }
  for (int i = 0; i < 50; ++i) {
    RawClient& client = clients.emplace_back(port_);
    client.send(kEvents);
    EXPECT_THAT(client.read_until("data: {}\n\n"), StartsWith("HTTP/1.1 200"));
  }
  wait_for_connections(300);
  for (int i = 0; i < 20; ++i) {
    EXPECT_TRUE(alive());
    EXPECT_THAT(raw("POST /echo HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\nConnection: "
                    "close\r\n\r\nhello"),
                HasSubstr("hello"));
  }
  for (int i = 250; i < 300; ++i) clients[static_cast<std::size_t>(i)].send("x");
  EXPECT_THAT(metrics_.text(), HasSubstr("stillmap_event_streams 50"));
  EXPECT_LT(stop_seconds(), 10.0);
}

TEST_F(TransportLoad, BeyondTheCapTheAnswerIsSoonAndInWords) {
  Endpoint endpoint = small_endpoint();
  endpoint.connections = 8;
  endpoint.event_streams = 8;
  start(endpoint);
  std::deque<RawClient> clients;
  for (int i = 0; i < 8; ++i) {
    clients.emplace_back(port_).send(kEvents);
    clients.back().read_until("data: {}\n\n");
  }
  const std::string answer = ask("GET", "/livez");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 503"));
  EXPECT_THAT(answer, HasSubstr("Retry-After: 1\r\n"));
  EXPECT_THAT(answer, HasSubstr("\"Busy\""));
  EXPECT_THAT(metrics_.text(), HasSubstr("connections_refused_total{reason=\"full\"} 1"));
}

TEST_F(TransportLoad, IdleConnectionsMakeRoom) {
  Endpoint endpoint = small_endpoint();
  endpoint.limits.keep_alive = std::chrono::seconds(60);
  start(endpoint);
  std::deque<RawClient> idle;
  for (int i = 0; i < 16; ++i) idle.emplace_back(port_);
  // The one that is sent away first may need a moment to go.
  bool answered = false;
  for (int i = 0; i < 100 && !answered; ++i) {
    answered = alive();
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_TRUE(answered);
}

TEST_F(TransportLoad, ReadersThatNeverReadMakeRoom) {
  Endpoint endpoint = small_endpoint();
  // So that it is not these times that end them.
  endpoint.limits.stall = std::chrono::seconds(60);
  endpoint.limits.transfer = std::chrono::seconds(60);
  endpoint.drain.timeout_s = 0;
  start(endpoint);
  std::vector<std::unique_ptr<RawClient>> attackers;
  for (int i = 0; i < 16; ++i) {
    attackers.push_back(std::make_unique<RawClient>(port_));
    for (int k = 0; k < 50; ++k)
      attackers.back()->send("GET /source HTTP/1.1\r\nHost: localhost\r\n\r\n");
  }
  bool answered = false;
  for (int i = 0; i < 100 && !answered; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    answered = alive();
  }
  EXPECT_TRUE(answered);
}

TEST_F(TransportLoad, ClientThatVanishesGivesItsStreamBack) {
  Endpoint endpoint = small_endpoint();
  // So that it is this time that ends it and none of the others.
  endpoint.limits.stall = std::chrono::seconds(60);
  endpoint.limits.transfer = std::chrono::seconds(60);
  endpoint.limits.unacknowledged = std::chrono::milliseconds(300);
  start(endpoint);
  RawClient stays(port_);
  RawClient vanishes(port_);
  for (RawClient* client : {&stays, &vanishes}) {
    client->send("GET /ticks HTTP/1.1\r\nHost: localhost\r\n\r\n");
    client->read_until("data: {}\n\n");
  }
  vanishes.vanish();
  wait_for_connections(1);
  EXPECT_THAT(metrics_.text(), HasSubstr("\nstillmap_event_streams 1\n"));
}

TEST_F(TransportLoad, SlowReaderMayTakeAsLongAsItIsAllowed) {
  const ServerOptions patient{.stall_timeout_s = 120, .transfer_timeout_s = 120};
  EXPECT_EQ(main_endpoint(patient).limits.unacknowledged, std::chrono::seconds(120));
  EXPECT_EQ(main_endpoint(ServerOptions{}).limits.unacknowledged, std::chrono::seconds(30));
}

TEST_F(TransportLoad, KeyHoldsNoMoreThanItsShareOfTheStreams) {
  Endpoint endpoint = small_endpoint();
  endpoint.event_streams = 4;
  start(endpoint);
  const auto opened = [&](RawClient& client, const std::string& key) {
    client.send("GET /events HTTP/1.1\r\nHost: localhost\r\n" + key + "\r\n");
    return client.read_until("\r\n\r\n");
  };
  const std::string one = "Authorization: Bearer one\r\n";
  std::deque<RawClient> clients;
  for (int i = 0; i < 2; ++i)
    EXPECT_THAT(opened(clients.emplace_back(port_), one), StartsWith("HTTP/1.1 200"));
  const std::string third = ask("GET", "/events", one);
  EXPECT_THAT(third, StartsWith("HTTP/1.1 429"));
  EXPECT_THAT(third, HasSubstr("TooManyRequests"));
  EXPECT_THAT(third, HasSubstr("Retry-After: 5\r\n"));
  EXPECT_THAT(opened(clients.emplace_back(port_), "Authorization: Bearer two\r\n"),
              StartsWith("HTTP/1.1 200"));
  clients.pop_front();
  wait_for_connections(2);
  // Its place is free again, and whoever needs no key has no share.
  EXPECT_THAT(opened(clients.emplace_back(port_), one), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(opened(clients.emplace_back(port_), ""), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(ask("GET", "/events"), HasSubstr("TooManyStreams"));
}

TEST_F(TransportLoad, WithoutKeysThereIsNoShare) {
  Endpoint endpoint = small_endpoint();
  endpoint.event_streams = 4;
  start(endpoint);
  std::deque<RawClient> clients;
  for (int i = 0; i < 4; ++i) {
    clients.emplace_back(port_).send(kEvents);
    EXPECT_THAT(clients.back().read_until("\r\n\r\n"), StartsWith("HTTP/1.1 200"));
  }
}

TEST_F(TransportLoad, StopsSoonWithOpenStreamsAndHalfSentRequests) {
  Endpoint endpoint = small_endpoint();
  endpoint.event_streams = 4;
  endpoint.limits = {.keep_alive = std::chrono::seconds(60),
                     .head = std::chrono::seconds(60),
                     .stall = std::chrono::seconds(60),
                     .transfer = std::chrono::seconds(60)};
  start(endpoint);
  RawClient stream(port_);
  stream.send(kEvents);
  stream.read_until("data: {}\n\n");
  RawClient head(port_);
  head.send("GET /livez HT");
  RawClient body(port_);
  body.send("POST /echo HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\nh");
  RawClient idle(port_);
  wait_for_connections(4);
  EXPECT_LT(stop_seconds(), 3.0);
  EXPECT_THAT(stream.read_to_end(), HasSubstr("event: end\ndata: {\"reason\": \"stopping\"}"));
}

TEST_F(TransportLoad, AnswerInHandIsGivenBeforeTheEnd) {
  start(small_endpoint());
  handler_.hold = true;
  RawClient client(port_);
  client.send("GET /slow HTTP/1.1\r\nHost: localhost\r\n\r\n");
  while (handler_.handled == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  http_->stop();
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  handler_.hold = false;
  const std::string answer = client.read_to_end();
  EXPECT_THAT(answer, HasSubstr("slowly"));
  EXPECT_THAT(answer, HasSubstr("Connection: close\r\n"));
}

TEST_F(TransportLoad, DrainsAfterItsDelay) {
  Endpoint endpoint = small_endpoint();
  endpoint.drain = {.delay_s = 1, .timeout_s = 1};
  start(endpoint);
  const Clock::time_point begin = Clock::now();
  http_->drain();
  const std::string answer = raw("GET /livez HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(answer, HasSubstr("alive"));
  EXPECT_THAT(answer, HasSubstr("Connection: close\r\n"));
  thread_.join();
  const std::chrono::duration<double> took = Clock::now() - begin;
  EXPECT_GT(took.count(), 0.99);
  EXPECT_LT(took.count(), 5.0);
}

TEST_F(TransportLoad, StopOverridesADrain) {
  Endpoint endpoint = small_endpoint();
  endpoint.drain = {.delay_s = 60, .timeout_s = 60};
  start(endpoint);
  http_->drain();
  EXPECT_TRUE(alive());
  EXPECT_LT(stop_seconds(), 3.0);
}

}  // namespace transport_load_test
}  // namespace stillmap::server
