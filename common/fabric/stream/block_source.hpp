#pragma once

namespace ledgerline::fabric {

/// Whose blocks a stream hands over.
enum class BlockSource {
  peer,     ///< the own peer's
  ordered,  ///< the first that comes: an orderer's, where our own validation needs no flag of the peer, which confirms
            ///< it later
};

}  // namespace ledgerline::fabric
