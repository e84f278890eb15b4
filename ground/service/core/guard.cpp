#include "ground/service/core/guard.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

namespace ledgerline::ground::service {
namespace {

/// In a time that does not depend on where they differ.
bool same_secret(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  unsigned differ = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    differ |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
  return differ == 0;
}

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  return text;
}

/// What may be a token: of the Authorization header, or of the stream's subprotocols.
std::vector<std::string_view> tokens_of(const Head& head) {
  constexpr std::string_view bearer = "bearer ", in_list = "token.";
  if (!head.websocket) {
    // A scheme's case is nobody's business (RFC 9110, 11.1).
    const auto same = [](char a, char b) { return std::tolower(static_cast<unsigned char>(a)) == b; };
    const std::string_view scheme = head.authorization.substr(0, bearer.size());
    if (!std::equal(scheme.begin(), scheme.end(), bearer.begin(), bearer.end(), same)) return {};
    return {head.authorization.substr(bearer.size())};
  }
  std::vector<std::string_view> tokens;
  constexpr std::size_t max_tokens = 4;
  for (std::string_view rest = head.subprotocols; !rest.empty() && tokens.size() < max_tokens;) {
    const auto comma = std::min(rest.find(','), rest.size());
    const std::string_view one = trimmed(rest.substr(0, comma));
    if (one.substr(0, in_list.size()) == in_list) tokens.push_back(one.substr(in_list.size()));
    rest.remove_prefix(std::min(comma + 1, rest.size()));
  }
  return tokens;
}

}  // namespace

Guard::Guard(std::string token, std::vector<std::string> hosts, bool tls)
    : token_(std::move(token)), hosts_(std::move(hosts)), scheme_(tls ? "https://" : "http://") {}

bool Guard::is_own(std::string_view host) const {
  return std::find(hosts_.begin(), hosts_.end(), host) != hosts_.end();
}

ApiAnswer Guard::check_place(const Head& head) const {
  if (!is_own(head.host)) return refusal(403, fmt::format("Host must be one of {}", fmt::join(hosts_, ", ")));
  const bool from_here = head.origin.empty() || (head.origin.substr(0, scheme_.size()) == scheme_ &&
                                                 head.origin.substr(scheme_.size()) == head.host);
  if (!from_here) return refusal(403, "asked by a page of another site");
  return {.status = 0, .body = {}};
}

Guard::Admission Guard::check(const Head& head, const FindSession& find) const {
  if (ApiAnswer place = check_place(head); place.status != 0) return {place};
  for (const std::string_view token : tokens_of(head)) {
    if (same_secret(token, token_)) return {{.status = 0, .body = {}}};
    if (token.size() != token_digits) continue;
    const Found found = find(token);
    if (found.session) return {{.status = 0, .body = {}}, found.session};
    if (found.over) return {refusal(401, session_over), {}, true};
  }
  return {refusal(401, "the token is missing, or it is another ground's")};
}

bool Budget::take(TimeNs now) {
  left_ = std::min(per_s_, left_ + per_s_ * to_seconds(std::max<TimeNs>(0, now - last_ns_)));
  last_ns_ = now;
  if (left_ < 1) return false;
  left_ -= 1;
  return true;
}

}  // namespace ledgerline::ground::service
