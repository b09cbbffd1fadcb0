!> Contact without impacts: the tooth goes on into the spring of the flank.
module lapwing_contact_compliant
  use lapwing_contact_law, only: contact_law_t
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: compliant_t

  type, extends(contact_law_t) :: compliant_t
  contains
    procedure :: reset, sums_chatter
  end type compliant_t

contains

  !> Nothing jumps.
  pure subroutine reset(self, flank_velocity, before, after, impact)
    class(compliant_t), intent(in) :: self
    real(wp), intent(in) :: flank_velocity       !! without effect
    real(wp), intent(in) :: before               !! approach velocity
    real(wp), intent(out) :: after               !! the same
    logical, intent(out) :: impact               !! no
    after = before
    impact = .false.
  end subroutine reset

  !> There is none.
  pure logical function sums_chatter(self, moves)
    class(compliant_t), intent(in) :: self
    logical, intent(in) :: moves                 !! without effect
    sums_chatter = .false.
  end function sums_chatter
end module lapwing_contact_compliant
