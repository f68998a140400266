#include <stillmap/server/server.hpp>

#include "http_server.hpp"

namespace stillmap::server {

struct Server::Parts {
  Parts(const ServerOptions& options, const std::filesystem::path& folder,
        const std::filesystem::path& web)
      : store(folder),
        service(options, store, build_aligners, read_web_assets(web)),
        http(options, service) {}

  maps::PackageStore store;
  Service service;
  HttpServer http;
};

Server::Server(const ServerOptions& options, const std::filesystem::path& store,
               const std::filesystem::path& web)
    : parts_(std::make_unique<Parts>(options, store, web)) {}
Server::~Server() = default;

int Server::bind() { return parts_->http.bind(); }
void Server::run() { parts_->http.run(); }
void Server::stop() { parts_->http.stop(); }

}  // namespace stillmap::server
