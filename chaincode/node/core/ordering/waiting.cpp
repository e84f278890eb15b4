#include "chaincode/node/core/ordering/waiting.hpp"

#include <algorithm>

#include "common/base/check.hpp"

namespace ledgerline::node {
namespace {

/// Urgent ones that leave before one that is not. With 1 a flood of states would halve what commands get; with 16 a
/// flood of valid commands would leave a fleet's states less than 20 a second of a slow disk's 300 blocks.
constexpr std::size_t urgent_weight = 4;

std::string megabytes(double bytes) { return std::to_string(static_cast<std::int64_t>(bytes / 1e6)) + " MB"; }

std::size_t kind_of(Urgency urgency) { return urgency == Urgency::none ? 1 : 0; }

}  // namespace

void FairLane::add(Entry entry) {
  Organisation& organisation = organisations_[entry.sender.msp_id];
  // Who had nothing waiting is not paid for the time in which it sent nothing.
  if (organisation.waiting.empty()) organisation.tag = std::max(organisation.tag, clock_);
  double& tag = organisation.tags[entry.sender];
  const QueueKey key{std::max(tag, organisation.clock), entry.turn};
  tag = key.tag + static_cast<double>(entry.envelope.size());
  organisation.waiting.emplace(key, std::move(entry));
  ++count_;
}

FairLane::Organisations::const_iterator FairLane::next() const {
  auto best = organisations_.end();
  for (auto one = organisations_.begin(); one != organisations_.end(); ++one) {
    const Organisation& organisation = one->second;
    if (organisation.waiting.empty()) continue;
    const auto rank = [](const Organisation& of) { return QueueKey{of.tag, of.waiting.begin()->first.turn}; };
    if (best == organisations_.end() || rank(organisation) < rank(best->second)) best = one;
  }
  return best;
}

FairLane::Entry FairLane::pop() {
  LEDGERLINE_CHECK(count_ > 0, "a lane gives an envelope only while one waits", count_);
  Organisation& organisation = organisations_.at(next()->first);
  const auto first = organisation.waiting.begin();
  Entry entry = std::move(first->second);
  clock_ = organisation.tag;
  organisation.clock = first->first.tag;
  organisation.tag += static_cast<double>(entry.envelope.size());
  organisation.waiting.erase(first);
  --count_;
  return entry;
}

void FairLane::forget(const crypto::IdentityName& sender) {
  const auto organisation = organisations_.find(sender.msp_id);
  if (organisation != organisations_.end()) organisation->second.tags.erase(sender);
}

double Waiting::spent(const Member& member, TimeNs now_ns) const {
  const double back =
      static_cast<double>(now_ns - member.spent_at_ns) / ns_per_s * static_cast<double>(config_.identity_bytes_per_s);
  return std::max(0.0, member.spent_bytes - back);
}

std::optional<std::string> Waiting::refusal(const Sender& sender, const Share& own, std::size_t size) const {
  // In sixteenths: of all places an identity may have a quarter, and with urgent ones that quarter's quarter, since
  // they delay the urgent ones of all others; all that is not urgent may have three quarters, of which one organisation
  // may have half, however many identities it has.
  const auto places = [&](std::size_t share) { return config_.max_waiting * share / 16; };
  const auto room = [&](std::size_t share) { return config_.max_waiting_bytes * share / 16; };
  const std::size_t kind = kind_of(sender.urgency);
  const bool urgent = kind == 0;
  const std::size_t count = own.count[kind], bytes = own.bytes[0] + own.bytes[1];
  if (count > 0 && (count >= places(urgent ? 1 : 4) || bytes + size > room(4))) {
    return std::to_string(count) + " envelopes of this identity wait for a block already";
  }
  const auto known = organisations_.find(sender.name.msp_id);
  const Share all = known == organisations_.end() ? Share{} : known->second;
  if (all.count[kind] > 0 &&
      (all.count[kind] >= places(urgent ? 2 : 6) || all.bytes[kind] + size > room(urgent ? 2 : 6))) {
    return std::to_string(all.count[kind]) + " envelopes of " + sender.name.msp_id + " wait for a block already";
  }
  const std::size_t share = urgent ? 16 : 12;
  if (!empty() && (this->count() >= places(share) || bytes_ + size > room(share))) {
    return std::to_string(this->count()) + " envelopes wait for a block already";
  }
  return std::nullopt;
}

std::optional<std::string> Waiting::add(const Sender& sender, std::string envelope, TimeNs now_ns) {
  if (members_.size() >= max_idle_identities) forget_idle(now_ns);
  Member& member = members_[sender.name];
  const std::size_t size = envelope.size(), kind = kind_of(sender.urgency);
  if (auto why = refusal(sender, member.waiting, size)) return why;
  const double spent_bytes = spent(member, now_ns), allowance = static_cast<double>(config_.identity_burst_bytes);
  if (kind == 1 && spent_bytes > 0 && spent_bytes + static_cast<double>(size) > allowance) {
    return "this identity has sent " + megabytes(spent_bytes) + ", and may send " +
           megabytes(static_cast<double>(config_.identity_bytes_per_s)) + " a second";
  }
  member.spent_bytes = spent_bytes + static_cast<double>(size);
  member.spent_at_ns = now_ns;
  for (Share* share : {&member.waiting, &organisations_[sender.name.msp_id]}) {
    ++share->count[kind];
    share->bytes[kind] += size;
  }
  lanes_[static_cast<std::size_t>(sender.urgency)].add({std::move(envelope), sender.name, now_ns, turns_++});
  arrivals_.insert(now_ns);
  bytes_ += size;
  return std::nullopt;
}

std::size_t Waiting::next_lane() const {
  const auto waits = [&](Urgency urgency) { return !lanes_[static_cast<std::size_t>(urgency)].empty(); };
  const bool others_turn = urgent_in_a_row_ >= urgent_weight && waits(Urgency::none);
  for (const Urgency urgency : {Urgency::stop, Urgency::control}) {
    if (waits(urgency) && !others_turn) return static_cast<std::size_t>(urgency);
  }
  return static_cast<std::size_t>(Urgency::none);
}

std::vector<std::string> Waiting::pop(std::size_t max_count, std::size_t max_bytes) {
  std::vector<FairLane::Entry> taken;
  std::size_t bytes = 0;
  while (!empty() && taken.size() < max_count) {
    const std::size_t lane = next_lane(), size = lanes_[lane].front().envelope.size();
    if (!taken.empty() && bytes + size > max_bytes) break;
    FairLane::Entry& entry = taken.emplace_back(lanes_[lane].pop());
    const std::size_t kind = kind_of(static_cast<Urgency>(lane));
    urgent_in_a_row_ = kind == 0 ? urgent_in_a_row_ + 1 : 0;
    for (Share* share : {&members_[entry.sender].waiting, &organisations_[entry.sender.msp_id]}) {
      LEDGERLINE_CHECK(share->count[kind] > 0 && share->bytes[kind] >= size, "what leaves the queue was counted in it",
                       entry.sender.msp_id, share->count[kind], share->bytes[kind], size);
      --share->count[kind];
      share->bytes[kind] -= size;
    }
    const auto arrival = arrivals_.find(entry.arrived_ns);
    LEDGERLINE_CHECK(arrival != arrivals_.end() && bytes_ >= size, "what leaves has arrived", bytes_, size);
    arrivals_.erase(arrival);
    bytes += size;
    bytes_ -= size;
  }
  std::ranges::sort(taken, {}, &FairLane::Entry::turn);
  std::vector<std::string> envelopes;
  envelopes.reserve(taken.size());
  for (FairLane::Entry& entry : taken) envelopes.push_back(std::move(entry.envelope));
  return envelopes;
}

/// A sender with nothing waiting and its whole allowance equals one that never sent, but for a tag ahead of the clock.
/// That tag is no more than it has sent in its last allowance.
void Waiting::forget_idle(TimeNs now_ns) {
  std::erase_if(members_, [&](const auto& one) {
    const Member& member = one.second;
    if (member.waiting.count != std::array<std::size_t, 2>{} || spent(member, now_ns) > 0) return false;
    for (FairLane& lane : lanes_) lane.forget(one.first);
    return true;
  });
}

}  // namespace ledgerline::node
