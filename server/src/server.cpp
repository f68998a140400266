#include <stillmap/server/server.hpp>

#include <stillmap/maps/error.hpp>
#include "blobs/blob_place.hpp"
#include "http/http_server.hpp"
#include "management.hpp"
#include "store/folder_lock.hpp"

#include <spdlog/spdlog.h>

#include <exception>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>

namespace stillmap::server {

namespace {

/// @return nothing where the file system allows no such lock. @throws InputError while the store is
/// migrated.
std::optional<FolderLock> lock_for_serving(const std::filesystem::path& store) {
  try {
    if (auto lock = FolderLock::try_folder(store, FolderLock::Kind::kShared)) return lock;
  } catch (const maps::StorageError& error) {
    spdlog::warn("{}: stop this server before `stillmap store migrate`", error.what());
    return std::nullopt;
  }
  throw maps::InputError(store.string(), "a store that is being migrated",
                         "one that is not: wait for `stillmap store migrate`, then start again");
}

}  // namespace

struct Server::Parts {
  Parts(const ServerOptions& options, const std::filesystem::path& folder,
        const std::filesystem::path& web, StoreChanges changes)
      : store(changes == StoreChanges::kTaken ? open_store(folder, options) : PackageStore(folder)),
        host(options.host),
        allow_without_keys(options.allow_without_keys),
        serving(lock_for_serving(folder)),
        takes_changes(changes == StoreChanges::kTaken),
        service(options, store, build_aligners, read_web_assets(web), find_mapper(), changes),
        http(main_endpoint(options), service, &service.metrics()),
        management(service) {
    if (options.management.enabled()) {
      management_http.emplace(management_endpoint(options), management, nullptr);
    }
  }

  /// Whoever reaches a server without keys may do everything.
  void require_keys() const {
    if (is_loopback(host) || allow_without_keys || !store.keys().list().empty()) return;
    throw std::invalid_argument("host: found " + host +
                                " and a store without keys, expected a loopback address, a key "
                                "(stillmap keys create), or --allow-without-keys");
  }

  void warn_without_keys(int port) const {
    if (is_loopback(host) || !store.keys().list().empty()) return;
    if (takes_changes)
      spdlog::warn(
          "the store has no key: every machine that reaches {}:{} can read, change and delete "
          "everything; make a key: stillmap keys create NAME --store {} --scope admin",
          host, port, store.folder().string());
    else
      spdlog::warn(
          "no key is asked for: every machine that reaches {}:{} can read the map and ask for "
          "poses; to ask for keys, serve a store: stillmap serve --store DIR",
          host, port);
  }

  mutable PackageStore store;
  std::string host;
  bool allow_without_keys;
  /// For `stillmap store migrate`, which changes what a server has in memory.
  std::optional<FolderLock> serving;
  bool takes_changes;
  Service service;
  HttpServer http;
  Management management;
  std::optional<HttpServer> management_http;
  int management_port = -1;
};

Server::Server(const ServerOptions& options, const std::filesystem::path& store,
               const std::filesystem::path& web, StoreChanges changes)
    : parts_(std::make_unique<Parts>(options, store, web, changes)) {}
Server::~Server() {
  // Its threads may wait for blobs.
  if (PackageBlobs* const blobs = parts_->store.blobs()) blobs->stop();
}

int Server::bind() {
  parts_->require_keys();
  const int port = parts_->http.bind();
  parts_->warn_without_keys(port);
  if (parts_->management_http) parts_->management_port = parts_->management_http->bind();
  return port;
}

int Server::management_port() const { return parts_->management_port; }

void Server::run() {
  std::thread watched;
  if (parts_->management_http) {
    watched = std::thread([this] {
      try {
        parts_->management_http->run();
      } catch (const std::exception& error) {
        spdlog::error("the management port is gone: {}", error.what());
      }
    });
  }
  // Health and metrics are there until the last answer is given.
  const auto end_management = [&] {
    if (!watched.joinable()) return;
    parts_->management_http->stop();
    watched.join();
  };
  try {
    parts_->http.run();
  } catch (...) {
    end_management();
    throw;
  }
  end_management();
}

void Server::reload(const ServerOptions& options) { parts_->service.reload(options); }

void Server::note_reload(bool well) { parts_->service.metrics().reloaded(well); }

void Server::stop() {
  parts_->service.set_stopping();
  parts_->http.stop();
}

void Server::drain() {
  parts_->service.set_stopping();
  parts_->http.drain();
}

std::function<void()> Server::prepare_trust(const ServerOptions& next) {
  return parts_->service.prepare_trust(next);
}

std::function<void()> Server::prepare_certificate() { return parts_->http.prepare_certificate(); }

}  // namespace stillmap::server
