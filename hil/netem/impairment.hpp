#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "hil/netem/distribution.hpp"
#include "hil/netem/recording/link_recording.hpp"

namespace ledgerline::hil {

/// What one direction of a connection does to what goes along it: plain data, all of it off at first.
/// hil/netem/emulated_link.hpp says in which order the effects come.
struct Impairment {
  /// Gilbert (1960) and Elliott (1963): with each datagram the link may turn bad or good again, and each loses its
  /// share.
  struct Loss {
    double good = 0;   ///< share lost while it is good; with `enter` 0 the only one: independent loss
    double bad = 1;    ///< share lost while it is bad
    double enter = 0;  ///< chance to turn bad, with each datagram
    double leave = 1;  ///< chance to turn good again, with each datagram
    bool operator==(const Loss&) const = default;
  };
  struct Duplication {
    double share = 0;
    Distribution after;  ///< how much later than the first one the second one is
  };
  struct Reordering {
    double share = 0;
    Distribution by;  ///< how long such a datagram is held back while others pass
  };
  struct Rate {
    double bytes_per_s = 0;
    std::size_t queue_bytes =
        0;  ///< what waits for its turn; beyond it datagrams are lost, and a stream's sender waits
    bool operator==(const Rate&) const = default;
  };

  /// A recorded link, played as it went on: its losses, and its delays beside `delay`.
  struct RecordedLink {
    std::shared_ptr<const LinkRecording> recording;
    std::string file;      ///< for text_of()
    TimeNs offset_ns = 0;  ///< into the recording: it begins there
    bool operator==(const RecordedLink&) const = default;
  };

  std::optional<Distribution> delay;   ///< keeps the order
  std::optional<Distribution> jitter;  ///< more delay, of each datagram by itself: they overtake each other
  std::optional<Loss> loss;
  std::optional<Duplication> duplicate;
  std::optional<Reordering> reorder;
  double corrupt = 0;   ///< share in which one bit is turned over
  double truncate = 0;  ///< share that loses its end
  std::optional<Rate> rate;
  std::optional<RecordedLink> recorded_link;
  bool stall = false;      ///< nothing comes out; when it ends, all that waited comes at once
  bool partition = false;  ///< datagrams are lost; bytes of a stream wait, and no connection is taken up

  bool any() const;
};

/// A bit for each kind of effect that it has.
unsigned kinds_in(const Impairment& impairment);

/// Overlays: each effect that `over` has replaces the one of its kind; the others stay.
void overlay(const Impairment& over, Impairment& impairment);

/// Puts one effect in the place of the one of its kind, or takes it out:
///
///     delay 200ms                     any DISTRIBUTION of hil/netem/distribution.hpp, here and below
///     jitter gamma 0.46s 0.2s
///     loss 5%                         each by itself
///     loss bursts 1% 20%              chance to turn bad and to turn good again, with each datagram; bad: all are lost
///     loss bursts 1% 20% 80% 0.1%     the same; lost while bad, lost while good
///     duplicate 5% 20ms               the second one comes so much later; without a time at once
///     reorder 5% 30ms                 held back by so much, so that others pass
///     corrupt 1%                      one bit
///     truncate 1%                     at least a byte less
///     rate 20kB/s queue 8kB           B/s, kB/s, MB/s; without `queue`: what goes through in a quarter of a second
///     recorded-day FILE at 90s        loss and delay of a recorded link (hil/netem/recording/link_recording.hpp), as
///                                     it went on from so far into it (s, min, h; without `at`: its start), and from
///                                     its start again at its end; in order
///     stall
///     partition
///     EFFECT off                      `delay off`, `stall off` ...
///     clear                           all of them off
///
/// On an error nothing is changed; it quotes what is wrong and says what is allowed.
Status apply_effect(std::string_view text, Impairment& impairment, const ReadRecording& read = read_recording,
                    const ReadLinkRecording& recording = read_link_recording);

/// Several effects with commas between, all of them or, on an error, none: "delay 200ms, loss 5%".
Status apply_effects(std::string_view text, Impairment& impairment, const ReadRecording& read = read_recording,
                     const ReadLinkRecording& recording = read_link_recording);

/// What apply_effects() reads as the same again; "clear" where nothing is impaired.
std::string text_of(const Impairment& impairment);

/// What a stream of bytes (TCP) cannot have: it delivers what was sent, in order, or nothing. The error names the first
/// such effect; a recorded link is one where anything is lost in it.
Status check_for_stream(const Impairment& impairment);

}  // namespace ledgerline::hil
