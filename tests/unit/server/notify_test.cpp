#include "operation/notify.hpp"

#include <gmock/gmock.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <cstring>
#include <stdexcept>

#include "support/temporary_folder.hpp"

namespace stillmap::server {
namespace notify_test {

using ::testing::HasSubstr;
using ::testing::StartsWith;

/// As a service manager listens.
class FakeManager {
 public:
  /// @param name  as in NOTIFY_SOCKET.
  explicit FakeManager(const std::string& name) : socket_(::socket(AF_UNIX, SOCK_DGRAM, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name.data(), name.size());
    if (name[0] == '@') address.sun_path[0] = '\0';
    const std::size_t end = name[0] == '@' ? 0 : 1;
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size() + end);
    EXPECT_EQ(::bind(socket_, reinterpret_cast<const sockaddr*>(&address), size), 0);
  }
  ~FakeManager() { ::close(socket_); }
  FakeManager(const FakeManager&) = delete;
  FakeManager& operator=(const FakeManager&) = delete;

  /// The next datagram; empty when none comes in time.
  [[nodiscard]] std::string next(int timeout_ms) const {
    pollfd poll{.fd = socket_, .events = POLLIN, .revents = 0};
    if (::poll(&poll, 1, timeout_ms) != 1) return {};
    std::array<char, 4096> buffer{};
    const ssize_t size = ::recv(socket_, buffer.data(), buffer.size(), 0);
    return {buffer.data(), static_cast<std::size_t>(size)};
  }

 private:
  int socket_;
};

TEST(Notifier, SpeaksToPathsAndAbstractNames) {
  const test::TemporaryFolder folder;
  const std::string abstract = "@stillmap-test-" + std::to_string(::getpid());
  for (const std::string& name : {(folder.path() / "notify").string(), abstract}) {
    const FakeManager manager(name);
    const Notifier notifier(name);
    EXPECT_TRUE(notifier.ready("listening"));
    EXPECT_EQ(manager.next(1000), "READY=1\nSTATUS=listening");
    EXPECT_TRUE(notifier.stopping("draining"));
    EXPECT_EQ(manager.next(1000), "STOPPING=1\nSTATUS=draining");
    EXPECT_TRUE(notifier.alive());
    EXPECT_EQ(manager.next(1000), "WATCHDOG=1");
    EXPECT_TRUE(notifier.reloading());
    EXPECT_THAT(manager.next(1000), StartsWith("RELOADING=1\nMONOTONIC_USEC="));
  }
}

TEST(Notifier, AStatusCannotBecomeAnotherAssignment) {
  const test::TemporaryFolder folder;
  const std::string name = (folder.path() / "notify").string();
  const FakeManager manager(name);
  EXPECT_TRUE(Notifier(name).status("a\nREADY=1"));
  EXPECT_EQ(manager.next(1000), "STATUS=a?READY=1");
}

TEST(Notifier, IsSilentWithoutAManagerAndRefusesOtherNames) {
  EXPECT_FALSE(Notifier("").listens());
  EXPECT_FALSE(Notifier("").ready("x"));
  EXPECT_FALSE(Notifier("/no/such/socket").ready("x"));
  for (const std::string& name : {std::string("relative"), std::string("@"), std::string("/"),
                                  std::string("vsock:2:1"), "/" + std::string(107, 'x')}) {
    EXPECT_THROW(Notifier{name}, std::invalid_argument) << name;
  }
}

TEST(Watchdog, SpeaksOnlyWhileTheServerIsHealthy) {
  const test::TemporaryFolder folder;
  const std::string name = (folder.path() / "notify").string();
  const FakeManager manager(name);
  const Notifier notifier(name);
  std::atomic<bool> healthy = true;
  const Watchdog watchdog(notifier, std::chrono::milliseconds(20), [&] { return healthy.load(); });
  for (int i = 0; i < 3; ++i) EXPECT_EQ(manager.next(5000), "WATCHDOG=1");
  healthy = false;
  // One may be under way.
  while (!manager.next(100).empty()) {
  }
  EXPECT_EQ(manager.next(60), "");
  healthy = true;
  EXPECT_EQ(manager.next(5000), "WATCHDOG=1");
}

TEST(Watchdog, EndsAtOnceHoweverLongItsInterval) {
  const Notifier nobody("");
  const Watchdog watchdog(nobody, std::chrono::hours(1), [] { return true; });
}

class WatchdogVariables : public ::testing::Test {
 protected:
  ~WatchdogVariables() override {
    ::unsetenv("WATCHDOG_USEC");
    ::unsetenv("WATCHDOG_PID");
  }
};

TEST_F(WatchdogVariables, AreForThisProcessAlone) {
  EXPECT_FALSE(watchdog_interval());
  ::setenv("WATCHDOG_USEC", "30000000", 1);
  EXPECT_EQ(watchdog_interval(), std::chrono::seconds(30));
  ::setenv("WATCHDOG_PID", "1", 1);
  EXPECT_FALSE(watchdog_interval());
  ::setenv("WATCHDOG_PID", std::to_string(::getpid()).c_str(), 1);
  EXPECT_EQ(watchdog_interval(), std::chrono::seconds(30));
  for (const char* bad : {"", "0", "-1", "1.5", "x", "99999999999999999999"}) {
    ::setenv("WATCHDOG_USEC", bad, 1);
    EXPECT_FALSE(watchdog_interval()) << bad;
  }
}

}  // namespace notify_test
}  // namespace stillmap::server
