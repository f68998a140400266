#include "http/remote_address.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <thread>

#include "http/http_server.hpp"
#include "http/proxy_protocol.hpp"
#include "raw_client.hpp"

namespace stillmap::server {
namespace remote_address_test {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string text_of(const std::string& address) {
  const auto parsed = IpAddress::parse(address);
  return parsed ? parsed->text() : "none";
}

TEST(IpAddress, IsReadAndWritten) {
  EXPECT_EQ(text_of("192.0.2.1"), "192.0.2.1");
  EXPECT_EQ(text_of("2001:DB8:0::1"), "2001:db8::1");
  EXPECT_EQ(text_of("::ffff:192.0.2.1"), "192.0.2.1") << "as it arrives on an IPv6 socket";
  for (const char* other : {"", " ", "192.0.2", "192.0.2.1.1", "192.0.2.256", "192.0.2.1 ", "a::g",
                            "[::1]", "::1%lo", "1.2.3.4:80", "example.org", "0x7f.1"})
    EXPECT_EQ(text_of(other), "none") << other;
  EXPECT_EQ(text_of(std::string("1.2.3.4\0", 8)), "none");
  EXPECT_EQ(text_of(std::string(4000, '1')), "none");
  EXPECT_TRUE(IpAddress::parse("127.3.2.1")->is_loopback());
  EXPECT_TRUE(IpAddress::parse("::1")->is_loopback());
  EXPECT_FALSE(IpAddress::parse("::")->is_loopback());
  EXPECT_FALSE(IpAddress::parse("2001:db8::1")->is_loopback());
}

TEST(TrustedProxies, AreAddressesAndNetworks) {
  const auto trusted = TrustedProxies::parse("10.0.0.0/9, 192.0.2.7,2001:db8::/33 ,::1");
  ASSERT_TRUE(trusted);
  const auto contains = [&](const char* text) { return trusted->contain(*IpAddress::parse(text)); };
  for (const char* inside : {"10.0.0.1", "10.127.255.255", "192.0.2.7", "2001:db8::5", "::1",
                             "2001:db8:7fff::1", "::ffff:10.1.2.3"})
    EXPECT_TRUE(contains(inside)) << inside;
  for (const char* outside :
       {"10.128.0.0", "192.0.2.6", "2001:db8:8000::1", "::2", "11.0.0.0", "::a00:1"})
    EXPECT_FALSE(contains(outside)) << outside;
  EXPECT_TRUE(TrustedProxies::parse("0.0.0.0/0")->contain(*IpAddress::parse("1.2.3.4")));
  EXPECT_FALSE(TrustedProxies::parse("0.0.0.0/0")->contain(*IpAddress::parse("::1")));
  EXPECT_FALSE(TrustedProxies::parse(" ")->contain(*IpAddress::parse("127.0.0.1")));
  for (const char* wrong : {"10.0.0.0/33", "10.0.0.0/-1", "10.0.0.0/", "10.0.0.0/8/8", "localhost",
                            "10.0.0.1,", ",", "::/129", "10.0.0.1 10.0.0.2"})
    EXPECT_FALSE(TrustedProxies::parse(wrong)) << wrong;
}

TEST(ForwardedAddress, IsTheRightmostThatIsNoTrustedProxy) {
  const auto trusted = *TrustedProxies::parse("10.0.0.0/8");
  const auto of = [&](const char* peer, const std::vector<std::string>& values) {
    return forwarded_address(*IpAddress::parse(peer), values, trusted).text();
  };
  EXPECT_EQ(of("10.0.0.1", {}), "10.0.0.1");
  EXPECT_EQ(of("10.0.0.1", {"192.0.2.1"}), "192.0.2.1");
  EXPECT_EQ(of("10.0.0.1", {"198.51.100.9, 192.0.2.1, 10.0.0.2"}), "192.0.2.1")
      << "what is left of it is the client's own claim";
  EXPECT_EQ(of("10.0.0.1", {"198.51.100.9", "192.0.2.1"}), "192.0.2.1") << "two headers";
  EXPECT_EQ(of("10.0.0.1", {"10.0.0.3, 10.0.0.2"}), "10.0.0.3");
  EXPECT_EQ(of("10.0.0.1", {"192.0.2.1:4711"}), "192.0.2.1");
  EXPECT_EQ(of("10.0.0.1", {"[2001:db8::1]:4711"}), "2001:db8::1");
  EXPECT_EQ(of("10.0.0.1", {"2001:db8::1"}), "2001:db8::1");
  for (const char* wrong : {"192.0.2.1, unknown", "192.0.2.1,", "192.0.2.1, [", "192.0.2.1, ::1]"})
    EXPECT_EQ(of("10.0.0.1", {wrong}), "10.0.0.1") << wrong;
  EXPECT_EQ(of("192.0.2.9", {"198.51.100.9"}), "192.0.2.9") << "no proxy of ours";
}

/// A header of the PROXY protocol, and the source in it: "none" when there is none, "own" for the
/// proxy's own.
std::string source_in(std::string bytes, std::size_t left = 0) {
  const auto header = read_proxy_header([&bytes](std::span<char> to) {
    if (bytes.size() < to.size()) return false;
    std::copy_n(bytes.begin(), to.size(), to.begin());
    bytes.erase(0, to.size());
    return true;
  });
  EXPECT_TRUE(!header || bytes.size() == left) << "reads not a byte more";
  if (!header) return "none";
  return header->source ? header->source->text() : "own";
}

std::string block(int command, int family, const std::string& rest, std::size_t length) {
  std::string bytes("\r\n\r\n\0\r\nQUIT\n", 12);
  bytes += static_cast<char>(command);
  bytes += static_cast<char>(family);
  bytes += static_cast<char>(length >> 8U);
  bytes += static_cast<char>(length & 255U);
  return bytes + rest;
}

TEST(ProxyProtocol, Version1) {
  EXPECT_EQ(source_in("PROXY TCP4 192.0.2.1 192.0.2.2 5000 443\r\n"), "192.0.2.1");
  EXPECT_EQ(source_in("PROXY TCP6 2001:db8::1 ::1 5000 443\r\nGET", 3), "2001:db8::1");
  EXPECT_EQ(source_in("PROXY UNKNOWN\r\n"), "own");
  EXPECT_EQ(source_in("PROXY UNKNOWN ffff::1 ffff::2 1 2\r\n"), "own");
  for (const std::string& wrong :
       {std::string(), std::string("PROXY"), std::string("GET / HTTP/1.1\r\n\r\n"),
        std::string("PROXY TCP4 192.0.2.1 192.0.2.2 5000 443\n"),
        std::string("PROXY TCP4 x 192.0.2.2 5000 443\r\n"),
        std::string("PROXY TCP5 192.0.2.1 1\r\n"),
        "PROXY TCP4 192.0.2.1 " + std::string(100, ' ') + "\r\n",
        "PROXY UNKNOWN" + std::string(5000, 'x')})
    EXPECT_EQ(source_in(wrong), "none") << wrong;
}

TEST(ProxyProtocol, Version2) {
  const std::string ipv4("\xc0\x00\x02\x01\xc0\x00\x02\x02\x13\x88\x01\xbb", 12);
  const std::string ipv6 = std::string("\x20\x01\x0d\xb8", 4) + std::string(11, '\0') + "\x01" +
                           std::string(16, '\0') + std::string(4, '\1');
  EXPECT_EQ(source_in(block(0x21, 0x11, ipv4, 12)), "192.0.2.1");
  EXPECT_EQ(source_in(block(0x21, 0x21, ipv6, 36)), "2001:db8::1");
  EXPECT_EQ(source_in(block(0x21, 0x11, ipv4 + std::string(100, 'x') + "GET", 112), 3), "192.0.2.1")
      << "what follows the addresses is skipped";
  EXPECT_EQ(source_in(block(0x20, 0x00, "", 0)), "own");
  EXPECT_EQ(source_in(block(0x20, 0x11, ipv4, 12)), "own");
  EXPECT_EQ(source_in(block(0x21, 0x31, std::string(216, 'x'), 216)), "own") << "a Unix socket";
  EXPECT_EQ(source_in(block(0x21, 0x11, ipv4, 11)), "none");
  EXPECT_EQ(source_in(block(0x21, 0x11, ipv4, 13)), "none");
  EXPECT_EQ(source_in(block(0x21, 0x21, ipv4, 12)), "none");
  EXPECT_EQ(source_in(block(0x11, 0x11, ipv4, 12)), "none");
  EXPECT_EQ(source_in(block(0x22, 0x11, ipv4, 12)), "none");
  EXPECT_EQ(source_in(block(0x21, 0x11, ipv4 + std::string(70'000, 'x'), 65'535)), "none");
}

/// Answers with the address that a request comes from.
class Mirror final : public RequestHandler {
 public:
  [[nodiscard]] Router::Match find(const HttpRequest& request) const override {
    return router_.match(request.method, request.path);
  }
  void admit(HttpRequest&, const Router::Match&) const override {}
  [[nodiscard]] HttpResponse handle(const HttpRequest& request,
                                    const Router::Match&) const override {
    return {
        .content_type = "text/plain", .body = "<" + request.remote_address + ">", .headers = {}};
  }

 private:
  Router router_{
      {{"GET", "/", [](const HttpRequest&, const PathParameters&) { return HttpResponse{}; }}}};
};

class AddressTest : public ::testing::Test {
 protected:
  void start() {
    options_.port = 0;
    options_.keep_alive_s = 60;
    http_ = std::make_unique<HttpServer>(main_endpoint(options_), mirror_, nullptr);
    port_ = http_->bind();
    thread_ = std::thread([this] { http_->run(); });
  }
  void TearDown() override {
    http_->stop();
    thread_.join();
  }
  [[nodiscard]] std::string ask(const std::string& before = {},
                                const std::string& fields = {}) const {
    RawClient client(port_);
    client.send(before + "GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + fields +
                "\r\n");
    return client.read_to_end();
  }

  Mirror mirror_;
  ServerOptions options_;
  std::unique_ptr<HttpServer> http_;
  int port_ = 0;
  std::thread thread_;
};

TEST_F(AddressTest, IsThePeersWhateverTheHeaderSays) {
  start();
  EXPECT_THAT(ask(), EndsWith("<127.0.0.1>"));
  EXPECT_THAT(ask({}, "X-Forwarded-For: 192.0.2.1\r\n"), EndsWith("<127.0.0.1>"));
  EXPECT_THAT(ask("PROXY TCP4 192.0.2.1 192.0.2.2 1 2\r\n"), StartsWith("HTTP/1.1 400"));
}

TEST_F(AddressTest, IsWhatATrustedProxySaysInTheHeader) {
  options_.trusted_proxies = "127.0.0.0/8";
  options_.forwarded = "x-forwarded-for";
  start();
  EXPECT_THAT(ask(), EndsWith("<127.0.0.1>"));
  EXPECT_THAT(ask({}, "X-Forwarded-For: 198.51.100.1\r\nX-Forwarded-For: 192.0.2.1\r\n"),
              EndsWith("<192.0.2.1>"));
}

TEST_F(AddressTest, IsWhatATrustedProxySaysInFrontOfTheConnection) {
  options_.trusted_proxies = "127.0.0.1";
  options_.forwarded = "proxy";
  start();
  EXPECT_THAT(ask("PROXY TCP4 192.0.2.1 192.0.2.2 1 2\r\n", "X-Forwarded-For: 1.2.3.4\r\n"),
              EndsWith("<192.0.2.1>"));
  EXPECT_THAT(ask("PROXY UNKNOWN\r\n"), EndsWith("<127.0.0.1>"));
  EXPECT_EQ(ask(), "") << "a connection of a proxy without it ends";
}

TEST_F(AddressTest, HoldsItsShareOfTheConnectionsAlone) {
  options_.trusted_proxies = "192.0.2.1";
  options_.forwarded = "x-forwarded-for";
  options_.connections = 8;
  start();
  RawClient one(port_);
  RawClient two(port_);
  for (RawClient* client : {&one, &two}) {
    client->send("GET / HTTP/1.1\r\nHost: localhost\r\n\r\n");
    EXPECT_THAT(client->read_until("127.0.0.1"), HasSubstr("200 OK"));
  }
  const std::string refused = ask();
  EXPECT_THAT(refused, StartsWith("HTTP/1.1 429 Too Many Requests\r\n"));
  EXPECT_THAT(refused, HasSubstr("2 connections"));
}

TEST_F(AddressTest, HoldsItsShareOfTheConnectionsBehindAProxyToo) {
  options_.trusted_proxies = "127.0.0.1";
  options_.forwarded = "proxy";
  options_.connections = 8;
  start();
  const std::string word = "PROXY TCP4 192.0.2.1 192.0.2.2 1 2\r\n";
  RawClient one(port_);
  RawClient two(port_);
  for (RawClient* client : {&one, &two}) {
    client->send(word + "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n");
    EXPECT_THAT(client->read_until("192.0.2.1"), HasSubstr("200 OK"));
  }
  EXPECT_EQ(ask(word), "");
  EXPECT_THAT(ask("PROXY TCP4 192.0.2.3 192.0.2.2 1 2\r\n"), EndsWith("<192.0.2.3>"));
}

TEST_F(AddressTest, OfThisMachineIsNotCountedWithoutProxies) {
  options_.connections = 4;
  start();
  RawClient one(port_);
  RawClient two(port_);
  for (RawClient* client : {&one, &two}) {
    client->send("GET / HTTP/1.1\r\nHost: localhost\r\n\r\n");
    EXPECT_THAT(client->read_until("127.0.0.1"), HasSubstr("200 OK"));
  }
  EXPECT_THAT(ask(), EndsWith("<127.0.0.1>"));
}

}  // namespace remote_address_test
}  // namespace stillmap::server
