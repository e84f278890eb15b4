#include "ground/service/core/connection_quota.hpp"

#include <arpa/inet.h>

#include <algorithm>
#include <array>
#include <vector>

namespace ledgerline::ground::service {

std::size_t ConnectionQuota::shared_of(const Owner& owner, std::size_t count) {
  return owner.who ? count - std::min(count, reserved) : count;
}

bool ConnectionQuota::acquire(const Owner& owner, Use use) {
  const Owner key = key_of(owner);
  const auto found = counts_.find(key);
  const std::size_t count = found == counts_.end() ? 0 : found->second;
  const std::size_t more = shared_of(key, count + 1) - shared_of(key, count);
  const std::size_t limit = use == Use::stream ? max_of_one : max_of_one / 2;
  if (count >= limit || shared_ + more > max_shared) return false;
  counts_[key] = count + 1;
  shared_ += more;
  return true;
}

void ConnectionQuota::release(const Owner& owner) {
  const auto found = counts_.find(key_of(owner));
  if (found == counts_.end()) return;
  shared_ -= shared_of(found->first, found->second) - shared_of(found->first, found->second - 1);
  if (--found->second == 0) counts_.erase(found);
}

std::string address_of(std::string_view text) {
  const std::string address(text.substr(0, text.find('%')));
  std::array<std::uint8_t, 16> bytes{};
  if (::inet_pton(AF_INET6, address.c_str(), bytes.data()) != 1) return address;
  constexpr std::array<std::uint8_t, 12> mapped{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};  // IPv4 by a socket of IPv6
  const bool is_mapped = std::equal(mapped.begin(), mapped.end(), bytes.begin());
  if (!is_mapped) std::fill(bytes.begin() + 8, bytes.end(), 0);
  std::array<char, INET6_ADDRSTRLEN> written{};
  ::inet_ntop(AF_INET6, bytes.data(), written.data(), written.size());
  return written.data();
}

std::size_t displaced_by_next(std::span<const UnauthenticatedClient> all, std::uint64_t random) {
  const bool all_ended = std::ranges::all_of(all, [](const auto& one) { return one.has_ended_handshake; });
  const auto may_go = [&](const UnauthenticatedClient& one) { return all_ended || !one.has_ended_handshake; };
  std::map<std::string_view, std::size_t> counts;
  std::size_t most = 0;
  for (const UnauthenticatedClient& one : all) {
    if (may_go(one)) most = std::max(most, ++counts[one.address]);
  }
  std::vector<std::size_t> candidates;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (may_go(all[i]) && counts[all[i].address] == most) candidates.push_back(i);
  }
  const std::size_t older_half = (candidates.size() + 1) / 2;
  return candidates[random % older_half];
}

}  // namespace ledgerline::ground::service
