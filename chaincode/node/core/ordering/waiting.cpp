#include "chaincode/node/core/ordering/waiting.hpp"

#include <algorithm>

namespace ledgerline::node {
namespace {

constexpr std::size_t max_members = 1'024;  // that are remembered though nothing of theirs waits

std::string megabytes(double bytes) { return std::to_string(static_cast<std::int64_t>(bytes / 1e6)) + " MB"; }

}  // namespace

double Waiting::spent(const Member& member, TimeNs now_ns) const {
  const double back =
      static_cast<double>(now_ns - member.spent_at_ns) / ns_per_s * static_cast<double>(config_.identity_bytes_per_s);
  return std::max(0.0, member.spent_bytes - back);
}

std::optional<std::string> Waiting::refusal(const Member& member, bool urgent, std::size_t size) const {
  // In sixteenths: of all places an identity may have a quarter, and with urgent ones that quarter's quarter, since they
  // delay the urgent ones of all others; all that is not urgent may have three quarters.
  const auto places = [&](std::size_t share) { return config_.max_waiting * share / 16; };
  const auto room = [&](std::size_t share) { return config_.max_waiting_bytes * share / 16; };
  const std::size_t own = member.count[urgent ? 0 : 1];
  if (own > 0 && (own >= places(urgent ? 1 : 4) || member.bytes + size > room(4))) {
    return std::to_string(own) + " envelopes of this identity wait for a block already";
  }
  const std::size_t share = urgent ? 16 : 12;
  if (!empty() && (count() >= places(share) || bytes_ + size > room(share))) {
    return std::to_string(count()) + " envelopes wait for a block already";
  }
  return std::nullopt;
}

std::optional<std::string> Waiting::add(const Sender& sender, std::string envelope, TimeNs now_ns) {
  if (members_.size() >= max_members) forget_idle(now_ns);
  Member& member = members_[sender.name];
  const std::size_t size = envelope.size();
  if (auto why = refusal(member, sender.urgent, size)) return why;
  const double spent_bytes = spent(member, now_ns), allowance = static_cast<double>(config_.identity_burst_bytes);
  if (!sender.urgent && spent_bytes > 0 && spent_bytes + static_cast<double>(size) > allowance) {
    return "this identity has sent " + megabytes(spent_bytes) + ", and may send " +
           megabytes(static_cast<double>(config_.identity_bytes_per_s)) + " a second";
  }
  member.spent_bytes = spent_bytes + static_cast<double>(size);
  member.spent_at_ns = now_ns;
  const std::size_t lane = sender.urgent ? 0 : 1;
  ++member.count[lane];
  member.bytes += size;
  Place place{0, turns_++};
  if (!sender.urgent) {
    place.tag = std::max(member.tag, clock_);
    member.tag = place.tag + static_cast<double>(size);
  }
  lanes_[lane].emplace(place, Held{std::move(envelope), &member, now_ns});
  arrivals_.insert(now_ns);
  bytes_ += size;
  return std::nullopt;
}

std::vector<std::string> Waiting::take(std::size_t max_count, std::size_t max_bytes) {
  std::vector<std::string> taken;
  std::size_t bytes = 0;
  for (std::size_t lane = 0; lane < lanes_.size(); ++lane) {
    while (!lanes_[lane].empty() && taken.size() < max_count) {
      auto& [place, held] = *lanes_[lane].begin();
      const std::size_t size = held.envelope.size();
      if (!taken.empty() && bytes + size > max_bytes) return taken;
      bytes += size;
      if (lane == 1) clock_ = place.tag;
      --held.member->count[lane];
      held.member->bytes -= size;
      arrivals_.erase(arrivals_.find(held.arrived_ns));
      bytes_ -= size;
      taken.push_back(std::move(held.envelope));
      lanes_[lane].erase(lanes_[lane].begin());
    }
  }
  return taken;
}

/// Whoever has nothing waiting and its whole allowance is as one who never came, but for a tag ahead of the clock,
/// which is no more than it has sent in its last allowance.
void Waiting::forget_idle(TimeNs now_ns) {
  std::erase_if(members_, [&](const auto& one) {
    return one.second.count == std::array<std::size_t, 2>{} && spent(one.second, now_ns) <= 0;
  });
}

}  // namespace ledgerline::node
