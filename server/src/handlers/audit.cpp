#include "bodies/audit_json.hpp"
#include "context.hpp"
#include "page_query.hpp"

namespace stillmap::server {

void add_audit_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back({"GET", "/v1/audit",
                    [&context](const HttpRequest& request, const PathParameters&) {
                      const PageQuery page = read_page(read_query(request, {"limit", "before"}));
                      return json_response(
                          audit_json(context.store.audit().list(page.limit, page.before)));
                    },
                    Access::kAdmin});
}

}  // namespace stillmap::server
