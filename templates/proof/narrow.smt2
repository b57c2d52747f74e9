; esea_q31_product: its four products are those of the 16-bit halves, and, as the distributive law puts
; these together, its two words are the whole 64-bit product: no carry is lost.
; C esea_q31.c esea_q31_product ESEA_Q31_NARROW
(set-logic QF_BV)
(define-fun below ((x (_ BitVec 32))) (_ BitVec 32) (bvand x #x0000ffff))
(define-fun above ((x (_ BitVec 32))) (_ BitVec 32) (bvashr x #x00000010))
(define-fun halves () Bool (and
  (= left_0 (below a)) (= right_0 (below b))
  (= left_1 (above a)) (= right_1 (below b))
  (= left_2 (above b)) (= right_2 (below a))
  (= left_3 (above a)) (= right_3 (above b))))
; What products of such halves can be.
(assert (bvule product_0 #xfffe0001))
(assert (bvsle #x80008000 product_1))
(assert (bvsle product_1 #x7ffe8001))
(assert (bvsle #x80008000 product_2))
(assert (bvsle product_2 #x7ffe8001))
(assert (bvsle #xc0008000 product_3))
(assert (bvsle product_3 #x40000000))
(define-fun wide ((x (_ BitVec 32))) (_ BitVec 64) ((_ sign_extend 32) x))
(define-fun exact () (_ BitVec 64)
  (bvadd (bvshl (wide product_3) #x0000000000000020)
    (bvadd (bvshl (bvadd (wide product_1) (wide product_2)) #x0000000000000010)
           ((_ zero_extend 32) product_0))))
(assert (not (and halves (= (concat c_return c_low) exact))))
(check-sat)
