!> Contact laws: what becomes of a tooth that arrives at a flank, and what holds it there.
module lapwing_contact_law
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: contact_law_t

  type, abstract :: contact_law_t
    real(wp) :: restitution = 1    !! epsilon, where there are impacts
  contains
    procedure(reset_i), deferred :: reset
    procedure(sums_chatter_i), deferred :: sums_chatter
    procedure :: is_rigid => no
    procedure :: asks_flank_velocity => no
  end type contact_law_t

  abstract interface
    !> Reset map of the approach velocity where a tooth arrives at a flank.
    pure subroutine reset_i(self, flank_velocity, before, after, impact)
      import :: contact_law_t, wp
      implicit none
      class(contact_law_t), intent(in) :: self
      real(wp), intent(in) :: flank_velocity       !! of the flank, along the approach; 0 unless the
                                                   !! law asks for it
      real(wp), intent(in) :: before               !! approach velocity, not negative
      real(wp), intent(out) :: after               !! and after; negative: the tooth rebounds
      logical, intent(out) :: impact               !! whether it jumps, or contact just begins
    end subroutine reset_i

    !> Whether the impacts on a flank become ever slower, so that infinitely many may end in a
    !> finite time.
    pure logical function sums_chatter_i(self, moves)
      import :: contact_law_t
      implicit none
      class(contact_law_t), intent(in) :: self
      logical, intent(in) :: moves                 !! whether the flank does
    end function sums_chatter_i
  end interface

contains

  !> `is_rigid`: an engaged tooth follows its flank until it would have to be pulled; nothing else
  !> may move then. `asks_flank_velocity`: the reset map needs it.
  pure logical function no(self)
    class(contact_law_t), intent(in) :: self
    no = .false.
  end function no
end module lapwing_contact_law
