#pragma once

#include "store/postgres_database.hpp"
#include "store/store_state.hpp"

#include "support/temporary_folder.hpp"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

namespace stillmap::test {

/// A PostgreSQL that ends with this process.
class PostgresServer {
 public:
  PostgresServer() { start(); }
  ~PostgresServer() { stop(SIGQUIT); }
  PostgresServer(const PostgresServer&) = delete;
  PostgresServer& operator=(const PostgresServer&) = delete;

  void start() {
    process_ = ::fork();
    if (process_ == 0) {
      const char* const script = std::getenv("STILLMAP_TEST_POSTGRES");
      ::execl(script, script, folder_.path().c_str(), "logging_collector=on", nullptr);
      ::_exit(127);
    }
    for (int i = 0; i < 600; ++i) {
      if (answers()) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    throw std::runtime_error("PostgreSQL did not start; " + folder_.path().string());
  }
  /// SIGQUIT ends it at once, as a crash does.
  void stop(int signal) {
    if (process_ <= 0) return;
    ::kill(process_, signal);
    ::waitpid(process_, nullptr, 0);
    process_ = -1;
  }
  /// As when its machine hangs: connections stay, and nobody answers.
  void freeze() { signal_all(SIGSTOP); }
  void thaw() { signal_all(SIGCONT); }
  [[nodiscard]] std::string address(const std::string& database) const {
    return "postgres:///" + database + "?user=postgres&host=" + folder_.path().string();
  }
  /// An empty one of that name.
  void create(const std::string& database) { run("postgres", "CREATE DATABASE " + database); }
  void run(const std::string& database, const std::string& sql) const {
    const server::PostgresAddress address(this->address(database));
    server::PostgresWatch watch(address);
    server::PostgresDatabase(address, watch).execute(sql);
  }

 private:
  void signal_all(int signal) const {
    // The first one starts the others.
    ::kill(process_, signal);
    const std::string id = std::to_string(process_);
    std::ifstream children("/proc/" + id + "/task/" + id + "/children");
    for (pid_t child = 0; children >> child;) ::kill(child, signal);
  }
  [[nodiscard]] bool answers() const {
    try {
      run("postgres", "SELECT 1");
      return true;
    } catch (const maps::StorageError&) {
      return false;
    }
  }
  TemporaryFolder folder_;
  pid_t process_ = -1;
};

/// Tests of the state run twice: in SQLite, and in PostgreSQL where STILLMAP_TEST_POSTGRES names
/// `tests/support/postgres.sh`.
inline bool states_are_in_postgres() { return std::getenv("STILLMAP_TEST_POSTGRES") != nullptr; }

inline PostgresServer& postgres() {
  static PostgresServer server;
  return server;
}

/// The state that SQLite keeps in this file, or one of PostgreSQL's in its place; the same again
/// for the same file.
[[nodiscard]] inline server::StoreState state_at(const std::filesystem::path& file,
                                                 server::DiskCalls& calls) {
  if (!states_are_in_postgres()) return server::StoreState(file, calls);
  static std::map<std::filesystem::path, std::string> names;
  auto& name = names[file];
  if (name.empty()) {
    name = "state_" + std::to_string(names.size());
    postgres().create(name);
  }
  return server::StoreState(server::PostgresAddress(postgres().address(name)));
}

}  // namespace stillmap::test
