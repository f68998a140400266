#pragma once

#include "service.hpp"

namespace stillmap::server {

/// What the management port answers: health as the main port does, and the metrics, which no
/// vehicle needs to see.
class Management final : public RequestHandler {
 public:
  /// @param service  outlives this.
  explicit Management(const Service& service);

  [[nodiscard]] Router::Match find(const HttpRequest& request) const override;
  void admit(HttpRequest& request, const Router::Match& match) const override;
  [[nodiscard]] HttpResponse handle(const HttpRequest& request,
                                    const Router::Match& match) const override;

 private:
  const Service& service_;
  Router router_;
};

}  // namespace stillmap::server
