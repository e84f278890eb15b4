#include <dds/ddsi/q_radmin.h>

#include <cstring>
#include <vector>

#include "common/dds/endpoint.hpp"
#include "tests/fuzz/entry.hpp"

/// Messages of any type as they come from the network, whole and in fragments.
namespace ledgerline::fuzz::dds_part {
namespace {

class CdrEntry final : public Entry {
 public:
  ~CdrEntry() override { ddsi_sertype_unref(type_); }
  std::vector<std::string> seeds() override {
    using namespace std::string_literals;
    return {"\0\1\0\0"s, "\0\0\0\3\0\0\0\1"s, "\0\1\0\2\5\0\0\0abcd\0\0\0\0"s};
  }
  Outcome feed(std::string_view bytes) override {
    const auto before = refused_->read();
    ddsi_serdata* const whole = from_two_pieces(bytes);
    ddsi_serdata* const fragmented = from_two_fragments(bytes);
    const auto got = dds::bytes_of(whole), again = dds::bytes_of(fragmented);
    const bool same = std::equal(got.begin(), got.end(), again.begin(), again.end());
    const bool taken = !got.empty();
    // What is handed on is what came, but for the header's padding.
    const bool as_it_came = !taken || (got.size() <= bytes.size() && got.size() + 3 >= bytes.size() && got[0] == 0 &&
                                       std::memcmp(got.data() + 4, bytes.data() + 4, got.size() - 4) == 0);
    ddsi_serdata_unref(whole);
    ddsi_serdata_unref(fragmented);
    const auto after = refused_->read();
    const std::uint64_t counted = after.total() - before.total();
    if (!same || !as_it_came || counted != (taken ? 0 : 2)) return refused("");
    return taken ? accepted() : dropped();
  }

 private:
  ddsi_serdata* from_two_pieces(std::string_view bytes) const {
    const std::size_t half = bytes.size() / 2;
    const ddsrt_iovec_t pieces[2] = {{const_cast<char*>(bytes.data()), half},
                                     {const_cast<char*>(bytes.data()) + half, bytes.size() - half}};
    return ddsi_serdata_from_ser_iov(type_, SDK_DATA, 2, pieces, bytes.size());
  }

  /// The second begins before the first ends.
  ddsi_serdata* from_two_fragments(std::string_view bytes) const {
    std::vector<unsigned char> packet(sizeof(nn_rmsg) + bytes.size());
    auto* const message = reinterpret_cast<nn_rmsg*>(packet.data());
    if (!bytes.empty()) std::memcpy(packet.data() + sizeof(nn_rmsg), bytes.data(), bytes.size());
    const std::size_t half = bytes.size() / 2, second = half / 2;
    nn_rdata tail{}, head{};
    tail.rmsg = head.rmsg = message;
    tail.min = static_cast<std::uint32_t>(second);
    tail.maxp1 = static_cast<std::uint32_t>(bytes.size());
    tail.payload_zoff = static_cast<std::uint16_t>(NN_OFF_TO_ZOFF(second));
    head.maxp1 = static_cast<std::uint32_t>(half);
    head.nextfrag = &tail;
    return ddsi_serdata_from_ser(type_, SDK_DATA, &head, bytes.size());
  }

  std::shared_ptr<dds::RefusedCounters> refused_ = std::make_shared<dds::RefusedCounters>();
  ddsi_sertype* type_ = dds::make_raw_type("made_up_msgs::msg::dds_::Nested_", refused_);
};

const Registration cdr({"dds.cdr", Kind::bytes, [] { return std::make_unique<CdrEntry>(); }, 0.02});

}  // namespace
}  // namespace ledgerline::fuzz::dds_part
