#pragma once

#include <stillmap/server/server_options.hpp>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>

namespace stillmap::server {

/// Whether a server takes requests that change its store. One that does not answers them 403
/// `ReadOnly`; poses, tiles and all that is read stay.
enum class StoreChanges : std::uint8_t { kTaken, kRefused };

/// The HTTP server over one folder of maps. The routes are in `server/reference.md`.
///
/// Answers `/livez` as soon as it runs; maps are indexed in the background and `/readyz` tells when
/// they are.
class Server {
 public:
  /// @param store  folder of a `PackageStore`; an empty one becomes a store.
  /// @param web    folder of the built web page; when it does not exist, `/` says that it was not
  /// built.
  /// @throws std::invalid_argument on broken options, maps::StorageError if a folder cannot be
  /// read.
  Server(const ServerOptions& options, const std::filesystem::path& store,
         const std::filesystem::path& web, StoreChanges changes = StoreChanges::kTaken);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  /// Takes the port, and the management port if there is one. @return its number.
  /// @throws std::runtime_error when it is taken or not allowed; std::invalid_argument when others
  /// than this machine would reach a store without keys, unless `allow_without_keys` is set.
  int bind();
  /// @return number of the management port; -1 when there is none, or before `bind`.
  [[nodiscard]] int management_port() const;
  /// Serves until `stop` or `drain`. Call once, after `bind`.
  void run();
  /// Takes no more requests and lets those in hand finish within `DrainOptions::timeout_s`. Safe
  /// from any thread, also before `run`.
  void stop();
  /// The same after `DrainOptions::delay_s`, in which everything is answered still; `/readyz` is
  /// 503 from now on. Returns at once; `run` returns when it is done.
  void drain();
  /// For the metrics: what was to be read again was, or not all of it.
  void note_reload(bool well);
  /// Puts those options in force that may change while it runs.
  /// @throws std::invalid_argument on broken options; those before stay in force.
  void reload(const ServerOptions& options);
  /// Reads the TLS certificate and its key again.
  /// @return what puts them in force for connections to come, and cannot fail.
  /// @throws maps::InputError when they cannot be used.
  [[nodiscard]] std::function<void()> prepare_certificate();
  /// The same with the keys of `ServerOptions::trusted_keys_file`.
  [[nodiscard]] std::function<void()> prepare_trust(const ServerOptions& next);

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace stillmap::server
