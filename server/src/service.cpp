#include "service.hpp"

#include "api_error.hpp"
#include "json/answers_json.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/store/store_refusal.hpp>

#include <algorithm>
#include <exception>
#include <stdexcept>
#include <thread>
#include <utility>

namespace stillmap::server {
namespace {

ServerOptions checked(const ServerOptions& options) {
  const std::vector<std::string> broken = options.violations();
  if (!broken.empty()) throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
  return options;
}

int worker_count(const ServerOptions& options) {
  if (options.workers > 0) return options.workers;
  return static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
}

/// The page speaks to this server alone, and no file is run as something else than it says.
void add_page_headers(HttpResponse& response) {
  response.headers.emplace_back("Content-Security-Policy", "default-src 'self'");
  response.headers.emplace_back("Referrer-Policy", "no-referrer");
}

HttpResponse asset_response(const WebAsset& asset) {
  HttpResponse response{.content_type = asset.content_type, .body = asset.body, .headers = {}};
  response.headers.emplace_back("Cache-Control",
                                asset.hashed ? "public, max-age=31536000, immutable" : "no-cache");
  add_page_headers(response);
  return response;
}

HttpResponse no_page(const HttpRequest&, const PathParameters&) {
  HttpResponse response{
      .content_type = "text/html; charset=utf-8",
      .body =
          "<!doctype html><title>stillmap</title><p>The server runs, but the web page was "
          "not built. The maps are listed at <a href=\"/v1/maps\">/v1/maps</a>.\n",
      .headers = {}};
  add_page_headers(response);
  return response;
}

/// What the store does not allow, in the words of the interface.
ErrorCode code_of(maps::StoreRefusal::Reason reason) {
  using Reason = maps::StoreRefusal::Reason;
  switch (reason) {
    case Reason::kUnknownMap:
      return ErrorCode::kUnknownMap;
    case Reason::kUnknownVersion:
      return ErrorCode::kUnknownVersion;
    case Reason::kOtherDigest:
      return ErrorCode::kVersionExists;
    case Reason::kActive:
      return ErrorCode::kVersionActive;
    case Reason::kNoPrevious:
      return ErrorCode::kNoPrevious;
    case Reason::kOtherRevision:
      return ErrorCode::kRevisionChanged;
  }
  return ErrorCode::kInternalError;
}

std::vector<Route> all_routes(const Context& context, const std::vector<WebAsset>& web) {
  std::vector<Route> routes;
  add_health_routes(routes, context);
  add_map_routes(routes, context);
  add_tile_routes(routes, context);
  add_localize_routes(routes, context);
  for (const WebAsset& asset : web) {
    // In a pattern a brace would stand for any name.
    if (asset.path.find('{') != std::string::npos) continue;
    routes.push_back(
        {"GET", asset.path,
         [asset](const HttpRequest&, const PathParameters&) { return asset_response(asset); },
         Access::kOpen});
  }
  const auto is_page = [](const WebAsset& asset) { return asset.path == "/"; };
  if (std::none_of(web.begin(), web.end(), is_page))
    routes.push_back({"GET", "/", no_page, Access::kOpen});
  return routes;
}

}  // namespace

HttpResponse problem_response(const ApiError& error, const std::string& request_id) {
  return {.status = info_of(error.code()).http_status,
          .content_type = "application/problem+json",
          .body = problem_json(error, request_id),
          .headers = error.headers()};
}

Service::Service(const ServerOptions& options, const maps::MapStore& store, AlignerBuilder builder,
                 const std::vector<WebAsset>& web)
    : options_(checked(options)),
      catalog_(store, std::move(builder)),
      workers_(worker_count(options_)),
      gate_(workers_, options_.queue),
      context_{options_, workers_, catalog_, gate_, std::chrono::steady_clock::now()},
      router_(all_routes(context_, web)) {}

Router::Match Service::admit(HttpRequest& request) const {
  Router::Match match = router_.match(request.method, request.path);
  request.caller = gatekeeper_.admit(request, match.route->access);
  if (match.route->reserve) {
    request.reservation = match.route->reserve(request, match.parameters);
  }
  return match;
}

HttpResponse Service::handle(HttpRequest request) const {
  try {
    const Router::Match match = admit(request);
    return handle(request, match);
  } catch (const ApiError& error) {
    return problem_response(error, request.request_id);
  }
}

HttpResponse Service::handle(const HttpRequest& request, const Router::Match& match) const {
  const auto logged = [&](ErrorCode code, const std::exception& error) {
    // Paths of this machine stay in the log.
    spdlog::error("{} {} {}: {}", request.request_id, request.method, request.path, error.what());
    return problem_response(ApiError(code, "the log says more"), request.request_id);
  };
  try {
    return match.route->handler(request, match.parameters);
  } catch (const ApiError& error) {
    return problem_response(error, request.request_id);
  } catch (const maps::StoreRefusal& error) {
    return problem_response(ApiError(code_of(error.reason()), error.what()), request.request_id);
  } catch (const maps::StorageError& error) {
    return logged(ErrorCode::kStorageError, error);
  } catch (const maps::InputError& error) {
    return logged(ErrorCode::kStorageError, error);
  } catch (const std::exception& error) {
    return logged(ErrorCode::kInternalError, error);
  }
}

}  // namespace stillmap::server
