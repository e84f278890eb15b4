#include "hil/netem/emulated_link.hpp"

#include <algorithm>

namespace ledgerline::hil {
namespace {

constexpr std::size_t piece_bytes = 1'460;  // TCP's on an Ethernet: with a rate a stream flows in such pieces

template <typename T, std::size_t n, std::size_t... i>
std::array<T, n> seeded(Random& seeds, std::index_sequence<i...>) {
  return {((void)i, T(seeds.next()))...};
}
template <typename T, std::size_t n>
std::array<T, n> seeded(std::uint64_t seed) {
  Random seeds(seed);
  return seeded<T, n>(seeds, std::make_index_sequence<n>());
}

}  // namespace

EmulatedLink::EmulatedLink(Kind kind, std::uint64_t seed)
    : kind_(kind), random_(seeded<Random, effects>(seed)), draws_(seeded<Draws, effects>(~seed)) {}

Status EmulatedLink::set(const Impairment& impairment) {
  if (kind_ == Kind::stream) {
    if (auto possible = check_for_stream(impairment); !possible) return possible;
  }
  if (impairment.loss != impairment_.loss) bad_ = false;
  if (impairment.rate != impairment_.rate) rate_free_at_ = 0;
  if (impairment.recorded_link != impairment_.recorded_link) recording_begins_.reset();
  impairment_ = impairment;
  return done;
}

void EmulatedLink::begin_recording(TimeNs now) {
  if (impairment_.recorded_link && !recording_begins_) recording_begins_ = now - impairment_.recorded_link->offset_ns;
}

LinkRecording::Delivery EmulatedLink::recorded_delivery(TimeNs now) const {
  if (!impairment_.recorded_link) return {};
  return impairment_.recorded_link->recording->at(now - *recording_begins_);
}

void EmulatedLink::push(TimeNs now, std::string_view bytes, std::uint64_t tag) {
  begin_recording(now);
  if (kind_ == Kind::datagrams) return push_datagram(now, std::string(bytes), tag);
  const std::size_t most = impairment_.rate ? piece_bytes : std::max<std::size_t>(1, bytes.size());
  do {
    push_piece(now, bytes.substr(0, most), tag);
    bytes.remove_prefix(std::min(most, bytes.size()));
  } while (!bytes.empty());
}

void EmulatedLink::push_datagram(TimeNs now, std::string bytes, std::uint64_t tag) {
  ++counts_.pushed;
  counts_.bytes_in += bytes.size();
  const LinkRecording::Delivery recorded = recorded_delivery(now);
  if (impairment_.partition || draw_loss() || recorded.lost) {
    ++counts_.lost;
    return;
  }
  if (!bytes.empty() && draw(truncate, impairment_.truncate)) {
    bytes.resize(random_[truncate].next() % bytes.size());
    ++counts_.truncated;
  }
  if (!bytes.empty() && draw(corrupt, impairment_.corrupt)) {
    const std::uint64_t bit = random_[corrupt].next() % (8 * bytes.size());
    bytes[bit / 8] = static_cast<char>(bytes[bit / 8] ^ (1 << (bit % 8)));
    ++counts_.corrupted;
  }
  const auto passed = pass_rate(now, bytes.size());
  if (!passed) {
    ++counts_.no_room;
    return;
  }
  TimeNs due = *passed;
  if (impairment_.delay) due += draws_[delay].next(*impairment_.delay);
  due += recorded.delay_ns;
  due = in_order_ = std::max(due, in_order_);
  if (impairment_.jitter) due += draws_[jitter].next(*impairment_.jitter);
  if (impairment_.reorder && draw(reorder, impairment_.reorder->share)) {
    due += draws_[reorder].next(impairment_.reorder->by);
    ++counts_.reordered;
  }
  if (impairment_.duplicate && draw(duplicate, impairment_.duplicate->share)) {
    ++counts_.duplicated;
    add_unit(due, {bytes, tag});
    due += draws_[duplicate].next(impairment_.duplicate->after);
  }
  add_unit(due, {std::move(bytes), tag});
}

void EmulatedLink::push_piece(TimeNs now, std::string_view bytes, std::uint64_t tag) {
  ++counts_.pushed;
  counts_.bytes_in += bytes.size();
  TimeNs due = now;
  if (impairment_.rate) {
    pass_rate(now, bytes.size());  // room() kept to the queue's bound
    due = rate_free_at_;
  }
  if (impairment_.delay) due += draws_[delay].next(*impairment_.delay);
  if (impairment_.jitter) due += draws_[jitter].next(*impairment_.jitter);
  due += recorded_delivery(now).delay_ns;
  due = in_order_ = std::max(due, in_order_);
  bytes_ += bytes.size();
  units_.emplace(std::pair(due, next_number_++), Unit{std::string(bytes), tag});
}

std::size_t EmulatedLink::room(TimeNs now) const {
  if (units_.size() >= max_units || bytes_ >= max_bytes) return 0;
  std::size_t room = max_bytes - bytes_;
  if (impairment_.rate) {
    const double left = static_cast<double>(impairment_.rate->queue_bytes) - rate_backlog_bytes(now);
    room = std::min(room, static_cast<std::size_t>(std::max(0.0, left)));
  }
  return room;
}

std::optional<EmulatedLink::Unit> EmulatedLink::pop(TimeNs now) {
  begin_recording(now);
  if (const auto due = next_due(); !due || *due > now) return std::nullopt;
  auto node = units_.extract(units_.begin());
  ++counts_.delivered;
  counts_.bytes_out += node.mapped().bytes.size();
  bytes_ -= node.mapped().bytes.size();
  return std::move(node.mapped());
}

std::optional<TimeNs> EmulatedLink::next_due() const {
  const bool held = impairment_.stall || (kind_ == Kind::stream && impairment_.partition);
  if (held || units_.empty()) return std::nullopt;
  return units_.begin()->first.first;
}

bool EmulatedLink::draw_loss() {
  if (!impairment_.loss) return false;
  const auto& model = *impairment_.loss;
  Random& random = random_[loss];
  if (random.uniform() < (bad_ ? model.leave : model.enter)) bad_ = !bad_;
  return random.uniform() < (bad_ ? model.bad : model.good);
}

bool EmulatedLink::draw(Effect effect, double of) { return of > 0 && random_[effect].uniform() < of; }

double EmulatedLink::rate_backlog_bytes(TimeNs now) const {
  return to_seconds(std::max<TimeNs>(0, rate_free_at_ - now)) * impairment_.rate->bytes_per_s;
}

std::optional<TimeNs> EmulatedLink::pass_rate(TimeNs now, std::size_t bytes) {
  if (!impairment_.rate) return now;
  const auto size = static_cast<double>(bytes);
  // An empty queue takes a datagram of any size; a stream keeps to room().
  const bool full =
      rate_free_at_ > now && rate_backlog_bytes(now) + size > static_cast<double>(impairment_.rate->queue_bytes);
  if (full && kind_ == Kind::datagrams) return std::nullopt;
  rate_free_at_ = std::max(now, rate_free_at_) + from_seconds(size / impairment_.rate->bytes_per_s);
  return rate_free_at_;
}

void EmulatedLink::add_unit(TimeNs due, Unit unit) {
  if (units_.size() >= max_units || bytes_ + unit.bytes.size() > max_bytes) {
    ++counts_.no_room;
    return;
  }
  bytes_ += unit.bytes.size();
  units_.emplace(std::pair(due, next_number_++), std::move(unit));
}

}  // namespace ledgerline::hil
