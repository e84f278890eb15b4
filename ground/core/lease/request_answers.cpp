#include "ground/core/lease/request_answers.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>

#include "common/access/grants.hpp"
#include "common/base/text.hpp"
#include "common/msg/contract.hpp"

namespace ledgerline::ground {
namespace {

constexpr fabric::RepeatLimits limits{.attempts = 10, .conflicts_only = true};

bool same(const Request& a, const Request& b) {
  return same_identity(a.who(), b.who()) && a.priority() == b.priority() && same_identity(a.delegate(), b.delegate());
}

std::string text_of(const Identity& who) { return printable(who.msp_id() + " " + who.subject()); }

}  // namespace

RequestAnswers::RequestAnswers(const FlightConfig& config)
    : config_(config), seed_(std::hash<std::string>{}(config.self.msp_id + config.self.subject)) {
  slots_.resize(config.drones.size());
}

void RequestAnswers::step(TimeNs now, const LeaseBook& leases, std::uint64_t& next_id,
                          std::vector<Submission>& submissions, std::vector<std::string>& notes) {
  for (std::size_t drone = 0; drone < slots_.size(); ++drone) {
    Slot& slot = slots_[drone];
    const Lease& lease = leases.of(drone);
    const bool ours = lease.record && lease.holder == config_.self;
    if (slot.known.empty() && (!ours || lease.record->requests().empty())) continue;
    follow(now, drone, ours ? &*lease.record : nullptr, notes);
    if (!slot.answer) choose(now, drone);
    if (!slot.answer || slot.id != 0 || now < slot.next_ns) continue;
    slot.id = next_id++;
    const char* function = config_.request_rule == RequestRule::deny ? contract::deny : contract::hand_over;
    submissions.push_back({slot.id, {function, {slot.answer->SerializeAsString()}}, true});
  }
}

/// `record`: null where the drone is not ours.
void RequestAnswers::follow(TimeNs now, std::size_t drone, const Control* record, std::vector<std::string>& notes) {
  Slot& slot = slots_[drone];
  std::erase_if(slot.known, [&](const OpenRequest& known) {
    const Request* request = record == nullptr ? nullptr : request_of(*record, known.request.who());
    return request == nullptr || !same(*request, known.request);
  });
  if (slot.answer && slot.id == 0 && (record == nullptr || request_of(*record, slot.answer->to()) == nullptr))
    slot.answer.reset();
  if (record == nullptr) return;
  for (const Request& request : record->requests()) {
    const auto is_it = [&](const OpenRequest& known) { return same(known.request, request); };
    if (std::ranges::any_of(slot.known, is_it)) continue;
    slot.known.push_back({request, now});
    std::string what = "hand_over or deny answers it";
    if (config_.request_rule != RequestRule::none) {
      what = fmt::format("{} in {:g} s, unless you answer first",
                         config_.request_rule == RequestRule::deny ? "denied" : "handed over",
                         to_seconds(config_.request_after_ns));
    }
    const std::string delegate = request.has_delegate() ? ", for " + text_of(request.delegate()) + " to command" : "";
    notes.push_back(fmt::format("{}: {} requests it{}, at priority {} (ours: {}): {}", record->drone(),
                                text_of(request.who()), delegate, request.priority(), record->priority(), what));
  }
}

void RequestAnswers::choose(TimeNs now, std::size_t drone) {
  if (config_.request_rule == RequestRule::none) return;
  Slot& slot = slots_[drone];
  const OpenRequest* best = nullptr;
  for (const OpenRequest& known : slot.known) {
    if (known.left || now - known.since_ns < config_.request_after_ns) continue;
    if (best == nullptr || known.request.priority() > best->request.priority()) best = &known;
  }
  if (best == nullptr) return;
  slot.answer.emplace();
  slot.answer->add_drones(config_.drones[drone].name);
  *slot.answer->mutable_to() = best->request.who();
  slot.repeat.emplace(limits, ++seed_, now);
  slot.next_ns = now;
}

std::optional<RequestAnswers::Ended> RequestAnswers::on_outcome(TimeNs now, const fabric::Outcome& outcome,
                                                                std::uint64_t id) {
  const auto slot = std::ranges::find_if(slots_, [&](const Slot& s) { return s.id == id && id != 0; });
  if (slot == slots_.end()) return std::nullopt;
  slot->id = 0;
  const auto next = slot->repeat->ended(now, outcome);
  slot->next_ns = slot->repeat->at_ns();
  Ended ended{static_cast<std::size_t>(slot - slots_.begin()), ""};
  if (next == fabric::Repeat::Next::again) return ended;
  const Identity to = slot->answer->to();
  slot->answer.reset();
  // The block that ends the request may come behind its outcome; whatever the end, it is not answered again by the
  // rule.
  for (OpenRequest& known : slot->known) known.left = known.left || same_identity(known.request.who(), to);
  if (next != fabric::Repeat::Next::on_ledger) {
    ended.problem = fmt::format("no answer to {}'s request: {}; it is left to you", text_of(to),
                                outcome.refusal ? outcome.refusal->words : outcome.message);
  }
  return ended;
}

}  // namespace ledgerline::ground
